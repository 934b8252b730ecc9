"""The one thread on which everything is decided: an Rx scheduler whose clock never steps."""

from __future__ import annotations

import logging
import time
from datetime import UTC, datetime, timedelta
from threading import Thread
from typing import TYPE_CHECKING, Any

from reactivex.scheduler import EventLoopScheduler

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import DisposableBase

log = logging.getLogger(__name__)


class Loop(EventLoopScheduler):
    """Takes the wall clock's time at start, then follows the monotonic clock, so setting the clock moves no timer."""

    def __init__(self) -> None:
        self._started = datetime.now(UTC)
        self._origin = time.monotonic()
        super().__init__(thread_factory=_thread)

    @property
    def now(self) -> datetime:
        """The loop's time."""
        return self._started + timedelta(seconds=time.monotonic() - self._origin)

    def schedule_absolute(self, duetime: Any, action: Callable[..., Any], state: Any = None) -> DisposableBase:
        """Schedule as usual, but log an action that raises: otherwise it would end the loop's thread."""
        return super().schedule_absolute(duetime, _guarded(action), state)


def _guarded(action: Callable[..., Any]) -> Callable[..., Any]:
    def act(*arguments: Any, **more: Any) -> Any:
        try:
            return action(*arguments, **more)
        except Exception:
            log.exception("internal error")
            return None

    return act


def _thread(target: Callable[[], None]) -> Thread:
    return Thread(target=target, name="loop", daemon=True)
