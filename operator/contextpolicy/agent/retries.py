"""Retries what failed, with growing pauses, until it succeeds. Nothing runs while nothing fails."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.resize.pauses import Pause
from contextpolicy.agent.keyed_timers import KeyedTimers

if TYPE_CHECKING:
    from reactivex.abc import SchedulerBase

AGAIN = Pause(1.0, 30.0)
"""Seconds: a busy group or a full disk may be free soon; what stays refused must not take time from plans."""


class RetryListener(Protocol):
    """Tries again."""

    def on_retry(self, key: str) -> None:
        """The pause is over."""


class Retries:
    """One timer for each key, such as a policy; called on the loop's thread."""

    def __init__(self, scheduler: SchedulerBase, listener: RetryListener) -> None:
        self._timers, self._listener = KeyedTimers(scheduler), listener
        self._times: dict[str, int] = {}

    def again(self, key: str) -> None:
        """It failed: try again after a pause; more failures meanwhile put nothing off."""
        if key not in self._timers:
            self._times[key] = self._times.get(key, 0) + 1
            self._timers.start(key, AGAIN.after(self._times[key]), lambda: self._listener.on_retry(key))

    def end(self, key: str) -> None:
        """It succeeded, or is no longer wanted."""
        self._times.pop(key, None)
        self._timers.end(key)

    def stop(self) -> None:
        """Stop all retries."""
        self._timers.stop()
