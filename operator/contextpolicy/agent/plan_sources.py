"""Which policies have a source of plans, and for how long a plan holds without one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.agent.keyed_timers import KeyedTimers

if TYPE_CHECKING:
    from reactivex.abc import SchedulerBase

LEAST = 4.0
"""Seconds that a source has at least to say its plan again: it is asked after 1 s, and after 3 s (`retries.AGAIN`)."""


class SilenceListener(Protocol):
    """Releases plans."""

    def on_silence(self, policy: str) -> None:
        """The policy's grace period is over."""


class PlanSources:
    """At most one grace period for each policy, of `grace` seconds; called on the loop's thread."""

    def __init__(self, scheduler: SchedulerBase, grace: float, listener: SilenceListener) -> None:
        self._graces, self._grace, self._listener = KeyedTimers(scheduler), grace, listener
        self._alive: set[str] = set()

    def __contains__(self, policy: str) -> bool:
        """Whether a source of plans for the policy is alive."""
        return policy in self._alive

    def find(self, policy: str) -> None:
        """A source is alive; a grace period goes on until the plan is known to hold."""
        self._alive.add(policy)

    def lose(self, policy: str) -> None:
        """The source is gone, or cut off by the network."""
        self._alive.discard(policy)
        self.wait(policy)

    def wait(self, policy: str) -> None:
        """The grace period begins."""
        self._start(policy, self._grace)

    def hold(self, policy: str) -> None:
        """A plan holds while its source lives. One that was delayed may have none any more: start the grace period."""
        if policy in self._alive:
            self._graces.end(policy)
        elif policy not in self._graces:
            self.wait(policy)

    def doubt(self, policy: str) -> None:
        """A message without proof of its sender came: the grace period begins, unless it has begun."""
        if policy not in self._graces:
            self._start(policy, max(self._grace, LEAST))

    def end(self, policy: str) -> None:
        """The policy has no plan to give up."""
        self._graces.end(policy)

    def stop(self) -> None:
        """Stop all grace periods."""
        self._graces.stop()

    def _start(self, policy: str, seconds: float) -> None:
        self._graces.start(policy, seconds, lambda: self._listener.on_silence(policy))
