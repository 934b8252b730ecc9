"""Plays what was recorded at its own pace: the world goes on while a source is suspended, and it does not wait."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterable, Iterator

    Value = TypeVar("Value")

LATE_NS = 1_000_000_000
"""What is later than this was missed while the source was suspended, or starved."""


class Playback:
    """Keeps the moment of the recording's beginning; `now` is the time in ns since 1970."""

    def __init__(self, now: Callable[[], int] = time.time_ns) -> None:
        self._now = now
        self._began: int | None = None

    def play(self, recorded: Iterable[tuple[int, Value]], ended: threading.Event) -> Iterator[tuple[int, Value]]:
        """Give each value when it is due, with that moment; `recorded` has times in ns from any beginning, in order."""
        first = None
        for at, value in recorded:
            first = at if first is None else first
            self._began = self._now() if self._began is None else self._began
            due = self._began + at - first
            if due < self._now() - LATE_NS:
                continue
            if ended.wait(max(due - self._now(), 0) / 1e9):
                return
            yield due, value
