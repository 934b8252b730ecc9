"""A placement seen through a policy: all of a division that weights don't change, worked out once per placement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from contextpolicy.planning.placement import QUANTUM
from contextpolicy.planning.shares import Demand
from contextpolicy.policy.spec import Control, Needs, Scheduler

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.planning.placement import Container, Placement
    from contextpolicy.policy.spec import Policy, Task

REALTIME_BUDGET = 950
"""Thousandths of the period for realtime tasks: the default of sched_rt_runtime_us / sched_rt_period_us. A reserve
leaves less: the same part of each processor as of the node's CPU."""


@dataclass(frozen=True, slots=True)
class Seat:
    """One task on one node; bounds in units of the node's quantum."""

    task: str
    containers: tuple[Container, ...]
    floors: tuple[int, ...]
    """What each container can't go below."""
    floor: int
    ceiling: int

    def claim(self, weight: float) -> Demand:
        """A suspended task claims the least possible, not its min."""
        if weight == 0:
            least = sum(self.floors)
            return Demand(self.task, 0.0, least, least, len(self.floors))
        return Demand(self.task, weight, self.floor, self.ceiling, len(self.floors))


@dataclass(frozen=True, slots=True)
class SeatedNode:
    """One node: N (or the realtime budget) in thousandths of a core, and the step that shares move in."""

    name: str
    capacity: int
    quantum: int
    seats: tuple[Seat, ...]
    scheduler: Scheduler = Scheduler.CFS


@dataclass(frozen=True, slots=True)
class Seating:
    """All nodes whose size is known, and the containers that may turn out short of something."""

    nodes: tuple[SeatedNode, ...] = ()
    demanding: tuple[Container, ...] = ()


def seat_tasks(policy: Policy, placement: Placement) -> Seating:
    """Place the policy's tasks; containers of tasks that it does not have are none of its business."""
    tasks = {task.name: task for task in policy.leaves}
    nodes = tuple(
        _node(_on(name, policy, placement), name, placement, [(tasks[t], c) for t, c in seated.items() if t in tasks])
        for name, seated in placement.by_node().items()
    )
    demanding = tuple(
        container
        for container in placement.containers
        if container.task in tasks and (tasks[container.task].needs != Needs() or container.floor > QUANTUM)
    )
    return Seating(nodes, demanding)


def _on(node: str, policy: Policy, placement: Placement) -> Policy:
    """The policy as it holds on a node, which may be unable to do realtime."""
    return replace(policy, scheduler=Scheduler.CFS) if node in placement.fair_only else policy


def _node(
    policy: Policy, name: str, placement: Placement, seated: Sequence[tuple[Task, Sequence[Container]]]
) -> SeatedNode:
    allocatable = placement.allocatable[name]
    divisible = max(0, allocatable - policy.reserve)
    if policy.scheduler is Scheduler.REALTIME:
        capacity, quantum = min(REALTIME_BUDGET, divisible * 1000 // max(1, allocatable)), 1
    else:
        capacity, quantum = divisible // QUANTUM * QUANTUM, QUANTUM
    seats = tuple(_seat(policy, *seat, capacity, quantum) for seat in seated)
    return SeatedNode(name, capacity, quantum, seats, policy.scheduler)


def _seat(policy: Policy, task: Task, containers: Sequence[Container], capacity: int, quantum: int) -> Seat:
    floors = tuple(_floor(policy, container) for container in containers)
    floor = max(sum(floors), -(-task.min // quantum))
    ceiling = (capacity if task.max is None else task.max) // quantum
    return Seat(task.name, tuple(containers), floors, floor, max(floor, ceiling))


def _floor(policy: Policy, container: Container) -> int:
    """Units below which a container can't go: where only limits move, its request holds it up."""
    if policy.scheduler is Scheduler.REALTIME or policy.control is not Control.LIMIT:
        return 1
    return container.floor // QUANTUM
