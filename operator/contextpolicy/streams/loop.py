"""The one thread on which everything is decided: an Rx scheduler whose clock never steps."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from threading import Thread
from typing import TYPE_CHECKING

from reactivex.scheduler import EventLoopScheduler

if TYPE_CHECKING:
    from collections.abc import Callable


class Loop(EventLoopScheduler):
    """Starts at the wall clock's time and then follows the monotonic clock, so a clock step moves no timer."""

    def __init__(self) -> None:
        self._started = datetime.now(UTC)
        self._origin = time.monotonic()
        super().__init__(thread_factory=_thread)

    @property
    def now(self) -> datetime:
        """The loop's time."""
        return self._started + timedelta(seconds=time.monotonic() - self._origin)


def _thread(target: Callable[[], None]) -> Thread:
    return Thread(target=target, name="loop", daemon=True)
