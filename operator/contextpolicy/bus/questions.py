"""Questions from the bus, answered one at a time: nobody who asks about all policies without pause delays a plan."""

from __future__ import annotations

import time
from collections import deque
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase

REST = 3.0
"""How many times as long as an answer took the loop has for everything else before the next one."""


class Questions:
    """Of all policies together. `clock` shows seconds and never steps."""

    def __init__(self, scheduler: SchedulerBase, clock: Callable[[], float] = time.monotonic) -> None:
        self._scheduler, self._clock = scheduler, clock
        self._lock, self._at_work = Lock(), False
        self._waiting: deque[Callable[[], None]] = deque()

    def ask(self, answer: Callable[[], None]) -> None:
        """Have `answer` called on the loop when its turn comes; called on any thread."""
        with self._lock:
            self._waiting.append(answer)
            begin, self._at_work = not self._at_work, True
        if begin:
            self._scheduler.schedule(self._answer)

    def _answer(self, *_: object) -> None:
        began, answer = self._clock(), self._waiting.popleft()
        try:
            answer()
        finally:
            with self._lock:
                self._at_work = more = bool(self._waiting)
            if more:
                self._scheduler.schedule_relative(REST * (self._clock() - began), self._answer)
