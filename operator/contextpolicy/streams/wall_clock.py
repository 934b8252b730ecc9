"""How far a scheduler's clock, which never steps, is from the wall clock, which people and NTP set."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from reactivex import Observable
from reactivex.disposable import SerialDisposable

from contextpolicy.planning.inputs import ClockSet

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.inputs import Input

STEP = 0.005
"""Seconds by which the wall clock must differ from what was known of it to count as set; less is noise."""
LOOK = 1.0
"""Seconds between two looks: Python has no way to wait until the clock is set."""
LOOK_BACK = 30.0
"""The same once the time is over that it is about: a clock that was ahead may yet be set back."""


class WallClock:
    """What the wall clock shows, and would have shown at other times of the scheduler had it been set as it is now.

    For what people read: an operator that starts before the first network time has its plans an hour off only until
    then. `read` gives Unix seconds.
    """

    def __init__(self, scheduler: SchedulerBase, read: Callable[[], float] = time.time) -> None:
        self._scheduler, self._read = scheduler, read
        self._ahead = 0.0

    @property
    def ahead(self) -> float:
        """By how many seconds the scheduler's time is ahead of it.

        The same to the last digit until the clock is set: a status that differs from the last one is written.
        """
        now = self._scheduler.to_seconds(self._scheduler.now) - self._read()
        if abs(now - self._ahead) > STEP:
            self._ahead = now
        return self._ahead

    def now(self) -> float:
        """Unix seconds."""
        return self._scheduler.to_seconds(self._scheduler.now) - self.ahead


def ahead(scheduler: SchedulerBase) -> float:
    """By how many seconds the scheduler's time is ahead of the wall clock."""
    return scheduler.to_seconds(scheduler.now) - time.time()


def settings(scheduler: SchedulerBase, until: float) -> Observable[Input]:
    """Each time that the wall clock is set, noticed soon until it shows `until` (Unix seconds), later after that."""

    def subscribe(observer: ObserverBase[Input], _: SchedulerBase | None = None) -> DisposableBase:
        timer, known = SerialDisposable(), ahead(scheduler)

        def look(*_: object) -> None:
            nonlocal known
            now = ahead(scheduler)
            if abs(now - known) > STEP:
                known = now
                observer.on_next(ClockSet(now))
            pause = LOOK if time.time() < until else LOOK_BACK
            timer.disposable = scheduler.schedule_relative(pause, look)

        look()
        return timer

    return Observable(subscribe)
