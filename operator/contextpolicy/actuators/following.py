"""An Rx operator that delays resizes on nodes that have an agent until the plan has settled.

The agent has already written the limits. A resize takes tens of milliseconds, and as much of the node's CPU: that of
the API server, its datastore, the kubelet and the runtime, which tasks lack. One that is overtaken by the next plan is
wasted, brings an old limit back until the agent corrects it, can fail on the kernel's rules, and costs flash 0.2 MiB.
The API only has to agree in the end: its limits hold when the agent is gone. A plan that does not last is never
ordered. When the agent is gone, the newest plan is ordered at once, as is a container that the agent could not set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from reactivex import Observable
from reactivex.disposable import CompositeDisposable, SerialDisposable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.allocation.plan import NodePlan

SETTLED = 30.0
"""Seconds for which a node's plan has to stay the same, by default: a context that is over sooner costs no resize."""

NodePlans: TypeAlias = "Mapping[str, NodePlan]"
"""Plans by node."""


def follow_agents(
    scheduler: SchedulerBase,
    settled: float,
    ahead: Callable[[], frozenset[str]],
    not_set: Callable[[], Mapping[str, str]],
) -> Callable[[Observable[NodePlans]], Observable[NodePlans]]:
    """Turn what is planned into what is to be ordered now: once for each item, and when a plan has settled.

    A node's plan has settled when it has stayed the same for so many seconds.
    Nodes in `ahead` have an agent: they keep the plan ordered last until the next has settled. A node whose first plan
    has not settled yet is missing. Containers that are `not_set` by their agent, with
    their tasks, do not wait.
    """

    def operator(source: Observable[NodePlans]) -> Observable[NodePlans]:
        def subscribe(observer: ObserverBase[NodePlans], _: SchedulerBase | None = None) -> DisposableBase:
            follower = _Follower(observer, scheduler, settled, ahead, not_set)
            subscription = source.subscribe(follower.on_next, observer.on_error, observer.on_completed)
            return CompositeDisposable(subscription, follower.timer)

        return Observable(subscribe)

    return operator


class _Waiting(NamedTuple):
    """A plan that is not ordered yet."""

    plan: NodePlan
    due: float


class _Follower:
    """One subscription."""

    def __init__(
        self,
        observer: ObserverBase[NodePlans],
        scheduler: SchedulerBase,
        settled: float,
        ahead: Callable[[], frozenset[str]],
        not_set: Callable[[], Mapping[str, str]],
    ) -> None:
        self.timer = SerialDisposable()
        self._settled = settled
        self._observer, self._scheduler, self._ahead, self._not_set = observer, scheduler, ahead, not_set
        self._planned: NodePlans = {}
        self._ordered: NodePlans = {}
        self._waiting: dict[str, _Waiting] = {}

    def on_next(self, planned: NodePlans) -> None:
        self._planned = planned
        self._emit()

    def _emit(self, *_: object) -> None:
        ahead = self._ahead()
        if ahead or self._waiting:
            now = self._scheduler.to_seconds(self._scheduler.now)
            self._waiting = {node: waiting for node, waiting in self._waiting.items() if node in self._planned}
            chosen = {node: self._choose(node, plan, now, ahead) for node, plan in self._planned.items()}
            self._ordered = {node: plan for node, plan in chosen.items() if plan is not None}
            self._arm(now)
        else:
            self._ordered = self._planned
        self._observer.on_next(self._ordered)

    def _choose(self, node: str, plan: NodePlan, now: float, ahead: frozenset[str]) -> NodePlan | None:
        waiting = self._waiting.pop(node, None) or _Waiting(plan, now + self._settled)
        ordered = self._ordered.get(node)
        if node not in ahead or plan == ordered:
            return plan
        if plan != waiting.plan:
            waiting = _Waiting(plan, now + self._settled)
        if now >= waiting.due:
            return plan
        self._waiting[node] = waiting
        return _taken_over(plan, ordered, self._not_set())

    def _arm(self, now: float) -> None:
        if self._waiting:
            due = min(waiting.due for waiting in self._waiting.values())
            self.timer.disposable = self._scheduler.schedule_relative(due - now, self._emit)


def _taken_over(plan: NodePlan, ordered: NodePlan | None, not_set: Mapping[str, str]) -> NodePlan | None:
    """What was ordered last, but with the plan's shares for containers that are `not_set`.

    Which tasks are suspended or capped is of the plan as well for those of these containers, and of the last order for
    the others: else their limits would move with each plan.

    What pays for their rise the agent has taken from the others already, but the API has not: there the sum of the
    limits may be that much more than the node's capacity.
    """
    if plan.containers.keys().isdisjoint(not_set):
        return ordered
    last = ordered if ordered is not None else plan._replace(containers={})
    before, moving = last.containers, {not_set[identity] for identity in plan.containers.keys() & not_set.keys()}
    own = {identity: share for identity, share in plan.containers.items() if identity in not_set}
    kept = {identity: before[identity] for identity in plan.containers.keys() & before.keys() - own.keys()}
    containers = own | kept
    return plan._replace(
        containers=containers,
        capacity=max(plan.capacity, sum(containers.values())),
        suspended=(last.suspended - moving) | (plan.suspended & moving),
        caps={
            **{task: cap for task, cap in last.caps.items() if task not in moving},
            **{task: cap for task, cap in plan.caps.items() if task in moving},
        },
    )
