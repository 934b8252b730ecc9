"""A camera as a task: while it is suspended, its device is closed and pictures cost nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotkit import Result, Task

if TYPE_CHECKING:
    import threading
    from collections.abc import Generator

    from modules.camera.sources import Source


class Camera(Task):
    """Publishes what its source sees, at most `rate` times a second."""

    def __init__(self, source: Source, *, output: str, rate: float | None = None) -> None:
        self._source = source
        self._output = output
        self._period = 0 if rate is None else round(1e9 / rate)

    def produce(self, ended: threading.Event) -> Generator[Result]:
        """Yield frames until the end; frames that come too early are skipped, so the rate holds on average."""
        due = 0
        for stamp, frame in self._source.frames(ended):
            if stamp >= due - self._period // 10:
                due = max(due, stamp - self._period) + self._period if due else stamp + self._period
                yield Result(self._output, frame, stamp)
