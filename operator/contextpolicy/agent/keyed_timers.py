"""Timers by key."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import DisposableBase, SchedulerBase


class KeyedTimers:
    """At most one timer for each key, such as a policy; called on the loop's thread."""

    def __init__(self, scheduler: SchedulerBase) -> None:
        self._scheduler = scheduler
        self._timers: dict[str, DisposableBase] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._timers

    def start(self, key: str, seconds: float, action: Callable[[], None]) -> None:
        """Call `action` in so many seconds, and nothing that was started for the key before."""
        self.end(key)
        self._timers[key] = self._scheduler.schedule_relative(seconds, lambda *_: self._on_time(key, action))

    def end(self, key: str) -> None:
        """Call nothing for the key."""
        timer = self._timers.pop(key, None)
        if timer is not None:
            timer.dispose()

    def stop(self) -> None:
        """End all."""
        for key in list(self._timers):
            self.end(key)

    def _on_time(self, key: str, action: Callable[[], None]) -> None:
        del self._timers[key]
        action()
