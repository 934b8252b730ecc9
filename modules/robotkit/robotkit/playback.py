"""Plays recordings at their own pace, also while their source is suspended: the world does not wait either."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterable, Iterator

    Value = TypeVar("Value")

LATE_NS = 1_000_000_000
"""A value later than this was missed while the source was suspended or starved, and is skipped."""


class Playback:
    """Remembers when the recording began, across suspensions; `now` gives the time in ns since 1970."""

    def __init__(self, now: Callable[[], int] = time.time_ns) -> None:
        self._now = now
        self._began: int | None = None

    def play(self, recorded: Iterable[tuple[int, Value]], ended: threading.Event) -> Iterator[tuple[int, Value]]:
        """Yield each value when it is due, with that moment; `recorded` has ascending times in ns from any origin."""
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
