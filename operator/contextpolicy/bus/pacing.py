"""Limits how often something that may change with every sample is reported."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from reactivex.disposable import Disposable, SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase


class Pacing:
    """Calls `tell` at once for the first news, then at most every `interval` seconds (leading and trailing edge).

    News in between shares one call, so the latest state always gets through. Without news no timer runs.
    """

    def __init__(self, scheduler: SchedulerBase, interval: float, tell: Callable[[], None]) -> None:
        self._scheduler, self._interval, self._tell = scheduler, interval, tell
        self._wake = SerialDisposable()
        self._waiting = False
        self._told_at = -math.inf

    def ask(self) -> None:
        """There is news: call `tell` now or when the interval is over."""
        if self._waiting:
            return
        rest = self._told_at + self._interval - self._now()
        if rest <= 0:
            self._act()
        else:
            self._waiting = True
            self._wake.disposable = self._scheduler.schedule_relative(rest, self._act)

    def rest(self) -> None:
        """Start a new interval: all news has just been reported some other way."""
        self._waiting = False
        self._told_at = self._now()
        self._wake.disposable = Disposable()

    def stop(self) -> None:
        """Cancel the pending call."""
        self._wake.dispose()

    def _act(self, *_: object) -> None:
        self.rest()
        self._tell()

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)
