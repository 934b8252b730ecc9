"""Which input a task takes next. Pure: the real tasks and the simulated ones ask the same object."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

EARLY = 1e-9
"""Seconds: what the floats of an arrival may be off."""


class Queue(StrEnum):
    """What becomes of inputs that wait."""

    NEWEST = "newest"
    """Each replaces the one before, which is missed."""
    LOSSLESS = "lossless"


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs number 0 to `count` - 1, arriving at `rate` a second from `phase` on.

    `windows` are the times at which the task takes input: what arrives outside of them, or waits when one ends, is
    dropped.
    """

    rate: float
    count: int
    queue: Queue
    windows: Sequence[tuple[float, float]]
    phase: float = 0.0

    def arrival(self, number: int) -> float:
        """When an input arrives."""
        return self.phase + number / self.rate

    def next(self, last: int, now: float) -> int | None:
        """The input to take now, after `last`; None if none waits."""
        begin = next((begin for begin, end in self.windows if begin <= now + EARLY < end), None)
        if begin is None:
            return None
        oldest = max(last + 1, self._first(begin))
        newest = min(self._last(now), self.count - 1)
        if oldest > newest:
            return None
        return newest if self.queue is Queue.NEWEST else oldest

    def wake(self, last: int, now: float) -> float | None:
        """When there may be an input to take, if none waits now; None after the last one."""
        for begin, end in self.windows:
            number = max(last + 1, self._first(begin), self._last(now) + 1)
            if number < self.count and self.arrival(number) < end:
                return self.arrival(number)
        return None

    def _first(self, time: float) -> int:
        """The first input that arrives then or later."""
        return math.ceil((time - self.phase - EARLY) * self.rate)

    def _last(self, time: float) -> int:
        """The last input that has arrived by then."""
        return math.floor((time - self.phase + EARLY) * self.rate)
