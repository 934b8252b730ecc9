"""Policies, placements and runs in a line each, so that a test shows only what it is about."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reactivex.notification import OnNext
from reactivex.testing import Recorded, TestScheduler

from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.allocation.plan import NodePlan, Plan
from contextpolicy.planning.conditions.absence import UNHEARD
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.planning.observable import plan_with
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from contextpolicy.policy.spec import Scheduler
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex import Observable

    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.spec import Policy

START = 1000.0
"""When stories begin: far from 0, so that a forgotten `now` shows."""


def a_body(**spec: Any) -> dict[str, Any]:
    """A ContextPolicy object around a spec written with the resource's own field names."""
    return {"metadata": {"name": "robot", "namespace": "lab"}, "spec": spec}


def limited(spec: Mapping[str, Any]) -> dict[str, Any]:
    """The spec under control Limit unless it says otherwise: there a share is what the kernel enforces."""
    return {**spec, "enforcement": {"control": "Limit", **spec.get("enforcement", {})}}


def a_policy(**spec: Any) -> Policy:
    return parsing.parse(a_body(**limited(spec)))


def a_task(name: str, **fields: Any) -> dict[str, Any]:
    return {"name": name, "selector": {"matchLabels": {"app": name}}, **fields}


def a_parent(name: str, *subtasks: str, **fields: Any) -> dict[str, Any]:
    return {"name": name, "subtasks": list(subtasks), **fields}


def a_stream(name: str, **fields: Any) -> dict[str, Any]:
    return {"name": name, "key": f"robot/{name}", **fields}


def a_context(name: str, when: str | None = None, /, tasks: Any = None, **fields: Any) -> dict[str, Any]:
    condition = {} if when is None else {"when": when}
    return {"name": name, **condition, "tasks": tasks or {}, **fields}


def on_node(*tasks: str, cores: float = 1.0, node: str = "robot", **fields: Any) -> Placement:
    """Each task once, on one node."""
    containers = tuple(Container(f"{task}@{node}", task, node, **fields) for task in tasks)
    return Placement({node: round(cores * 1000)}, containers)


def together(*placements: Placement) -> Placement:
    """Several nodes as one placement."""
    allocatable = {node: size for placement in placements for node, size in placement.allocatable.items()}
    return Placement(allocatable, tuple(c for placement in placements for c in placement.containers))


def a_plan(
    sequence: int, containers: Mapping[str, int], arrived: float | None = None, scheduler: Scheduler = Scheduler.CFS
) -> Plan:
    """A plan as it is to its containers, on one node."""
    node = NodePlan(1000, {}, containers, scheduler)
    return Plan(sequence, START, "test", (), {}, {"robot": node}, (), arrived)


class Story:
    """A planner from its start on; seconds count from there, plans collect in `plans`."""

    def __init__(self, policy: Policy, placement: Placement | None = None) -> None:
        self._health_listeners: list[Callable[[], object]] = []
        self.planner = Planner(policy, self, {})
        self.plans: list[Plan] = self.planner.start(START)
        if placement is None:
            placement = on_node(*(task.name for task in policy.leaves))
        self.place(placement, at=0.0)

    def on_health(self) -> None:
        for listener in self._health_listeners:
            listener()

    def on_each_health(self, listener: Callable[[], object]) -> None:
        self._health_listeners.append(listener)

    def sample(
        self, stream: str, *, at: float, stamp: float | None = None, arrived: float | None = None, **fields: Any
    ) -> None:
        timestamp = None if stamp is None else START + stamp
        self.take(Sample(stream, fields, timestamp, arrived), at=at)

    def place(self, placement: Placement, *, at: float) -> None:
        self.take(placement, at=at)

    def gone(self, stream: str, *, at: float) -> None:
        self.take(Gone(stream), at=at)

    def take(self, event: Input, *, at: float) -> None:
        self.plans += self.planner.handle(event, START + at)

    def wait(self, until: float) -> None:
        self.plans += self.planner.advance(START + until)

    def next_decision(self) -> float | None:
        """When something is due next; the hour after which a stream is reported silent decides nothing."""
        due = self.planner.next_due()
        return None if due is None or due > START + UNHEARD - 1 else due

    @property
    def last(self) -> Plan:
        return self.plans[-1]

    def shares(self) -> dict[str, int]:
        return {name: task.share for name, task in self.last.tasks.items()}

    def weights(self) -> dict[str, float]:
        return {name: weight.value for name, weight in self.planner.weights.items()}

    def drops(self) -> dict[tuple[str, str], int]:
        return dict(self.planner.drops)

    def contexts_over_time(self) -> list[tuple[float, tuple[str, ...]]]:
        """When the set of active contexts changed, and to what; of one instant only the end."""
        at_end = {round(plan.time - START, 6): plan.contexts for plan in self.plans}
        seen: list[tuple[float, tuple[str, ...]]] = []
        for at, contexts in at_end.items():
            if not seen or seen[-1][1] != contexts:
                seen.append((at, contexts))
        return seen


def record(
    policy: Policy,
    inputs: Mapping[float, Input],
    *,
    until: float,
    initiatives: Mapping[str, Instantiate] | None = None,
    planner: Planner | None = None,
) -> list[tuple[float, Plan]]:
    """What `observable.plans` emits in virtual time: (seconds, plan); the subscription is made at 1 s."""
    scheduler = TestScheduler()
    source: Observable[Input] = scheduler.create_hot_observable(
        *(Recorded(at, OnNext(event)) for at, event in inputs.items())  # type: ignore[arg-type]
    )
    made = source.pipe(plan_with(planner or Planner(policy, Quiet(), {}), scheduler, initiatives))
    observer = scheduler.start(lambda: made, created=0.5, subscribed=1.0, disposed=until)
    seen: list[tuple[float, Plan]] = []
    for message in observer.messages:
        assert isinstance(message.value, OnNext), message
        seen.append((message.time, message.value.value))
    return seen
