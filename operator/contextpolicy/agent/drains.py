"""Which suspended tasks may still finish the input that they are at."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.agent.keyed_timers import KeyedTimers

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from reactivex.abc import SchedulerBase

DRAIN = 0.5
"""Seconds in which a suspended task may finish the input that it is at, with the least weight: a quota at once would
freeze it, and with it what a robot has already seen or heard. Measured by `make bench-enforcement`."""


class DrainListener(Protocol):
    """Suspends."""

    def on_drained(self, policy: str) -> None:
        """One of the policy's suspended tasks has had its time."""


class Drains:
    """Each task's time begins when it is suspended, whatever other plans come meanwhile."""

    def __init__(self, scheduler: SchedulerBase, listener: DrainListener) -> None:
        self._scheduler, self._listener, self._timers = scheduler, listener, KeyedTimers(scheduler)
        self._due: dict[str, dict[Path, float]] = {}

    def rest(self, policy: str, groups: Iterable[Path]) -> set[Path]:
        """The policy suspends these groups, and no others; returns those that may go on for a while."""
        now, before = self._scheduler.to_seconds(self._scheduler.now), self._due.get(policy, {})
        due = {group: before.get(group, now + DRAIN) for group in groups}
        self._due[policy] = due
        draining = {group for group, end in due.items() if end > now}
        if draining:
            pause = min(due[group] for group in draining) - now
            self._timers.start(policy, pause, lambda: self._listener.on_drained(policy))
        return draining

    def forget(self, policy: str) -> None:
        """The policy no longer suspends anything."""
        self._due.pop(policy, None)
        self._timers.end(policy)
