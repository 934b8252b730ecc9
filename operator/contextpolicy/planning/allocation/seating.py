"""A placement seen through a policy: all of a division that weights don't change, computed once per placement."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.placement import QUANTUM
from contextpolicy.planning.allocation.shares import Demand
from contextpolicy.policy.activities import Needs
from contextpolicy.policy.bandwidth import PERIOD, throttle_gap
from contextpolicy.policy.spec import Control, Scheduler

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from contextpolicy.planning.allocation.placement import Container, Placement
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.policy.spec import Policy, Task

REALTIME_BUDGET = 950
"""Thousandths of each processor's period for realtime tasks: the default of sched_rt_runtime_us / sched_rt_period_us.
Less where N, spread over all processors, comes to less."""


@dataclass(frozen=True, slots=True)
class Seat:
    """One task on one node; bounds in units of the node's quantum."""

    task: str
    containers: tuple[Container, ...]
    floors: tuple[int, ...]
    """What each container can't go below."""
    suspended: int
    """What they keep together while the task is suspended."""
    floor: int
    ceiling: int
    protected: bool = False

    def claim(self, weight: float, *, protect: bool = True) -> Demand:
        """A suspended task claims what it keeps, not its min; a protected one never less than its min.

        Without `protect` its min is scaled down with the other floors: there is not enough for all protected ones.
        """
        least = self.floor if self.protected and protect else len(self.floors)
        if weight == 0:
            floor = self.floor if self.protected else self.suspended
            return Demand(self.task, 0.0, floor, floor, least)
        return Demand(self.task, weight, self.floor, self.ceiling, least)


@dataclass(frozen=True, slots=True)
class SeatedNode:
    """One node: N and the step that shares move in, in thousandths of a core; `period` is in seconds.

    A realtime share is a part of the period of each processor alike, so there the step is a thousandth of each.
    """

    name: str
    capacity: int
    quantum: int
    seats: tuple[Seat, ...]
    scheduler: Scheduler = Scheduler.CFS
    period: float = PERIOD
    protects: bool = False
    """Whether any of its tasks is protected."""
    caps: Mapping[str, int] = field(default_factory=dict)
    """The `max` of each task whose own an active context changes, in thousandths of a core."""

    def throttle_gap(self, share: int) -> float:
        """Seconds for which one busy thread may be throttled with this share."""
        of_one = share // self.quantum if self.scheduler is Scheduler.REALTIME else share
        return throttle_gap(of_one, self.period)

    def claims(self, weights: Mapping[str, Weight], last: Sequence[Demand] = ()) -> list[Demand]:
        """Each task's claim; one of unchanged weight keeps that of `last`, an earlier result of this node's."""
        if not last:  # nearly every plan has all weights but one from the plan before
            return [seat.claim(weights[seat.task].value) for seat in self.seats]
        return [
            claim if claim.weight == (weight := weights[claim.name].value) else seat.claim(weight)
            for seat, claim in zip(self.seats, last, strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Seating:
    """All nodes of known size, the containers that may come up short of their needs, and the tasks without a pod.

    `agents` are the nodes whose agents write quotas.
    """

    nodes: tuple[SeatedNode, ...] = ()
    demanding: tuple[Container, ...] = ()
    absent: frozenset[str] = frozenset()
    agents: frozenset[str] = frozenset()


def seat_tasks(policy: Policy, placement: Placement) -> Seating:
    """Seat the policy's tasks on their nodes; containers of other tasks are ignored."""
    tasks = {task.name: task for task in policy.leaves}
    seats = {
        name: [(tasks[task], containers) for task, containers in seated.items() if task in tasks]
        for name, seated in placement.by_node().items()
    }
    nodes = tuple(
        _node(_on(name, policy, placement), name, placement, seated) for name, seated in seats.items() if seated
    )
    demanding = tuple(
        container
        for container in placement.containers
        if container.task in tasks
        and (
            tasks[container.task].needs != Needs()
            or holds_up(policy, tasks[container.task], container, placement.agents)
        )
    )
    return Seating(nodes, demanding, placement.absent, placement.agents)


def holds_up(policy: Policy, task: Task, container: Container, agents: Collection[str]) -> bool:
    """Whether the container's request keeps its limit up when it is suspended; `agents` are nodes that have one."""
    moves = policy.enforcement.control is Control.WEIGHT or container.node in agents
    return container.floor > task.suspended_cpu and not moves


def _on(node: str, policy: Policy, placement: Placement) -> Policy:
    """The policy as it holds on a node, which may be unable to do realtime."""
    fair = replace(policy.enforcement, scheduler=Scheduler.CFS)
    return replace(policy, enforcement=fair) if node in placement.fair_only else policy


def _node(
    policy: Policy, name: str, placement: Placement, seated: Sequence[tuple[Task, Sequence[Container]]]
) -> SeatedNode:
    allocatable = placement.allocatable[name]
    divisible = max(0, min(allocatable - policy.reserve, placement.left.get(name, allocatable)))
    own = policy.enforcement
    if own.scheduler is Scheduler.REALTIME:
        quantum, period = placement.processors_of(name), own.period
        units = min(REALTIME_BUDGET, divisible // quantum)
    else:
        quantum, period = QUANTUM, placement.quota_periods.get(name, own.period)
        units = divisible // quantum
    led = name in placement.agents
    seats = tuple(
        _seat(
            task,
            containers,
            tuple(_floor(policy, one, led=led) for one in containers),
            most=units,
            quantum=quantum,
            scheduler=own.scheduler,
        )
        for task, containers in seated
    )
    protects = any(seat.protected for seat in seats)
    return SeatedNode(name, units * quantum, quantum, seats, own.scheduler, period, protects)


def _seat(  # noqa: PLR0913 - a task, its containers, and what bounds them on the node
    task: Task,
    containers: Sequence[Container],
    floors: tuple[int, ...],
    *,
    most: int,
    quantum: int,
    scheduler: Scheduler,
) -> Seat:
    # A suspended task leaves realtime, so what it keeps is no part of that budget.
    kept = 1 if scheduler is Scheduler.REALTIME else -(-task.suspended_cpu // quantum)
    suspended = sum(max(one, kept) for one in floors)
    floor = max(suspended, -(-task.min // quantum))
    # A request can hold the floor above `max`; the ceiling rises with it, as `Demand` needs floor <= ceiling.
    ceiling = most if task.max is None else task.max // quantum
    return Seat(task.name, tuple(containers), floors, suspended, floor, max(floor, ceiling), task.protected)


def _floor(policy: Policy, container: Container, *, led: bool) -> int:
    """Units below which a container can't go: where only limits move, and no agent leads, its request holds it up."""
    if led or policy.enforcement.scheduler is Scheduler.REALTIME or policy.enforcement.control is not Control.LIMIT:
        return 1
    return container.floor // QUANTUM
