"""The plans that agents have yet to confirm, each within its time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from reactivex.abc import DisposableBase, SchedulerBase

    from contextpolicy.cluster.agent_reports import Stamp


class LateListener(Protocol):
    """Receives plans that were not confirmed in time."""

    def on_late(self, node: str) -> None:
        """The node's agent has not confirmed a plan in time, and is expected to confirm nothing any more."""


class Unconfirmed:
    """By node and policy; a node is `in` it while its agent has a plan to confirm."""

    def __init__(self, scheduler: SchedulerBase, listener: LateListener) -> None:
        self._scheduler, self._listener = scheduler, listener
        self._waiting: dict[str, dict[str, _Waiting]] = {}

    def __contains__(self, node: str) -> bool:
        return node in self._waiting

    def expect(self, node: str, policy: str, stamp: Stamp, bound: float) -> None:
        """The node's agent must confirm this plan, or a later one of the policy, within so many seconds."""
        plans = self._waiting.setdefault(node, {})
        waiting = plans.get(policy)
        if waiting is None:
            plans[policy] = _Waiting(stamp, stamp, bound, self._arm(node, bound))
        else:
            waiting.last = stamp

    def confirm(self, node: str, policy: str, stamp: Stamp) -> None:
        """The node's agent has carried out this plan."""
        waiting = self._waiting.get(node, {}).get(policy)
        if waiting is None or stamp < waiting.first:
            return
        # A confirmation of a plan between `first` and `last` proves the agent is alive: the clock restarts for `last`.
        if stamp >= waiting.last:
            self._end(node, policy)
        else:
            waiting.timer.dispose()
            waiting.first, waiting.timer = waiting.last, self._arm(node, waiting.bound)

    def forget(self, policy: str) -> None:
        """The policy's source of plans is gone."""
        for node in [node for node, plans in self._waiting.items() if policy in plans]:
            self._end(node, policy)

    def _arm(self, node: str, bound: float) -> DisposableBase:
        return self._scheduler.schedule_relative(bound, lambda *_: self._on_time(node))

    def _on_time(self, node: str) -> None:
        for policy in list(self._waiting[node]):
            self._end(node, policy)
        self._listener.on_late(node)

    def _end(self, node: str, policy: str) -> None:
        plans = self._waiting[node]
        plans.pop(policy).timer.dispose()
        if not plans:
            del self._waiting[node]


@dataclass(slots=True)
class _Waiting:
    """The first and the last plan of a policy that a node's agent has yet to confirm."""

    first: Stamp
    last: Stamp
    bound: float
    """Seconds that the agent has."""
    timer: DisposableBase
