"""Where a node agent is ahead of the resizes, they follow at a distance: once the plan has settled.

A resize takes tens of milliseconds. One that is overtaken by the next plan brings an old limit back until the agent
puts its own in place again, and can fail on the kernel's rules; a storm of contexts would be a storm of these. The API
only has to agree in the end: it is what holds when the agent is gone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from reactivex.disposable import SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex.abc import SchedulerBase

    from contextpolicy.planning.plan import NodePlan

SETTLED = 0.5
"""Seconds for which a node's plan must have been the same."""
LONGEST = 5.0
"""Seconds after which a plan is ordered even if there has been another one every moment."""


@dataclass(slots=True)
class _Waiting:
    """A node's plan that is not ordered yet: since when there is one, and since when it is this one."""

    plan: NodePlan
    began: float
    since: float

    @property
    def due(self) -> float:
        return min(self.since + SETTLED, self.began + LONGEST)


class Follower:
    """Says which plans to order; `again` is called, on the loop's thread, when there is more to order."""

    def __init__(self, scheduler: SchedulerBase, again: Callable[[], None]) -> None:
        self._scheduler, self._again = scheduler, again
        self._ordered: dict[str, NodePlan] = {}
        self._waiting: dict[str, _Waiting] = {}
        self._wake = SerialDisposable()

    def choose(self, nodes: Mapping[str, NodePlan], ahead: frozenset[str]) -> dict[str, NodePlan]:
        """The plans to order now, by node; nodes in `ahead` have an agent. A node without one keeps what it has."""
        now = self._scheduler.to_seconds(self._scheduler.now)
        self._waiting = {node: waiting for node, waiting in self._waiting.items() if node in nodes}
        self._ordered = {
            node: chosen
            for node, plan in nodes.items()
            if (chosen := self._choose(node, plan, now) if node in ahead else plan) is not None
        }
        self._arm(now)
        return self._ordered

    def stop(self) -> None:
        """Order nothing later."""
        self._wake.dispose()

    def _choose(self, node: str, plan: NodePlan, now: float) -> NodePlan | None:
        waiting = self._waiting.pop(node, None) or _Waiting(plan, now, now)
        ordered = self._ordered.get(node)
        if plan == ordered:
            return plan
        if plan != waiting.plan:
            waiting = _Waiting(plan, waiting.began, now)
        if now >= waiting.due:
            return plan
        self._waiting[node] = waiting
        return ordered

    def _arm(self, now: float) -> None:
        if self._waiting:
            due = min(waiting.due for waiting in self._waiting.values())
            self._wake.disposable = self._scheduler.schedule_relative(due - now, lambda *_: self._again())
