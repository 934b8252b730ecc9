"""Delay resizes on nodes that have an agent until the plan has settled.

The agent has already written the limits. A resize takes tens of milliseconds, and as much of the node's CPU: that of
the API server, its datastore, the kubelet and the runtime, which tasks lack. One that is overtaken by the next plan is
wasted, brings an old limit back until the agent corrects it, and can fail on the kernel's rules. The API only has to
agree in the end: its limits hold when the agent is gone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from reactivex.disposable import SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex.abc import SchedulerBase

    from contextpolicy.planning.allocation.plan import NodePlan

SETTLED = 3.0
"""Seconds for which a node's plan must stay the same before it is ordered."""
LONGEST = 30.0
"""Seconds after which the newest plan is ordered even if plans keep changing."""


@dataclass(slots=True)
class _Waiting:
    """A plan that is not ordered yet: `began` is when its node started to wait, `since` when this very plan came."""

    plan: NodePlan
    began: float
    since: float

    @property
    def due(self) -> float:
        return min(self.since + SETTLED, self.began + LONGEST)


class Follower:
    """Decides which plans to order now; calls `again`, on the loop's thread, when a waiting plan is due."""

    def __init__(self, scheduler: SchedulerBase, again: Callable[[], None]) -> None:
        self._scheduler, self._again = scheduler, again
        self._ordered: dict[str, NodePlan] = {}
        self._waiting: dict[str, _Waiting] = {}
        self._wake = SerialDisposable()

    def choose(self, nodes: Mapping[str, NodePlan], ahead: frozenset[str]) -> dict[str, NodePlan]:
        """The plans to order now, by node; those in `ahead` have an agent, and keep the last until the next is due."""
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
        """Cancel the timer: waiting plans are never ordered."""
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
