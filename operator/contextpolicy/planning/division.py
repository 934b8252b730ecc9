"""Weights and placement -> what each container gets, node by node (Eq. 1 and Eq. 2 with bounds)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.errors import ShareError
from contextpolicy.planning.placement import QUANTUM
from contextpolicy.planning.plan import NodePlan, Shortfall
from contextpolicy.planning.policy import Control, Scheduler
from contextpolicy.planning.shares import Claim, divide, floors_exceed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.planning.placement import Container, Placement
    from contextpolicy.planning.policy import Policy, Task
    from contextpolicy.planning.weights import Weight

REALTIME_BUDGET = 950
"""Thousandths of the period for realtime tasks: the default of sched_rt_runtime_us / sched_rt_period_us."""


@dataclass(frozen=True, slots=True)
class Division:
    """All nodes' plans and what could not be met on them."""

    nodes: Mapping[str, NodePlan]
    shortfalls: tuple[Shortfall, ...]


@dataclass(frozen=True, slots=True)
class Terms:
    """What one node's division starts from: N, the step that shares move in, and each task's claim in steps."""

    capacity: int
    quantum: int
    claims: tuple[Claim, ...]


@dataclass(frozen=True, slots=True)
class _Seat:
    """One task on one node."""

    task: Task
    weight: Weight
    containers: list[Container]


def divide_nodes(
    policy: Policy, weights: Mapping[str, Weight], placement: Placement, last: Mapping[str, NodePlan]
) -> Division:
    """Divide each node; a node that can't be divided keeps its last plan and says why."""
    tasks = {task.name: task for task in policy.leaves}
    nodes: dict[str, NodePlan] = {}
    shortfalls: list[Shortfall] = []
    for node, seated in placement.by_node().items():
        seats = [_Seat(tasks[name], weights[name], containers) for name, containers in seated.items()]
        try:
            nodes[node], unmet_floors = _divide_node(policy, placement.allocatable[node], seats)
            shortfalls += unmet_floors
        except ShareError as error:
            shortfalls.append(Shortfall("", f"node {node} keeps its last plan: {error}"))
            if node in last:
                nodes[node] = last[node]
    return Division(nodes, tuple(shortfalls))


def terms(policy: Policy, weights: Mapping[str, Weight], placement: Placement) -> dict[str, Terms]:
    """Each node's terms, for explanations."""
    tasks = {task.name: task for task in policy.leaves}
    return {
        node: _terms(policy, placement.allocatable[node], [_Seat(tasks[n], weights[n], c) for n, c in seated.items()])
        for node, seated in placement.by_node().items()
    }


def _terms(policy: Policy, allocatable: int, seats: Sequence[_Seat]) -> Terms:
    realtime = policy.scheduler is Scheduler.REALTIME
    quantum = 1 if realtime else QUANTUM
    capacity = REALTIME_BUDGET if realtime else max(0, allocatable - policy.reserve) // QUANTUM * QUANTUM
    claims = tuple(_claim(policy, seat, quantum, capacity) for seat in seats)
    return Terms(capacity, quantum, claims)


def _divide_node(policy: Policy, allocatable: int, seats: Sequence[_Seat]) -> tuple[NodePlan, list[Shortfall]]:
    if not any(seat.weight.value > 0 for seat in seats):
        raise ShareError("the weights of all its tasks sum to 0, allowed: at least one above 0")
    own = _terms(policy, allocatable, seats)
    units = divide(own.capacity // own.quantum, own.claims)
    shares = {name: share * own.quantum for name, share in sorted(units.items())}
    containers = {
        container.id: part * own.quantum
        for seat in seats
        for container, part in _parts(policy, units[seat.task.name], seat.containers)
    }
    return NodePlan(own.capacity, shares, containers), _floor_shortfall(own.capacity, own.quantum, own.claims)


def _claim(policy: Policy, seat: _Seat, quantum: int, capacity: int) -> Claim:
    """A suspended task gets the least possible, not its min."""
    task, pods = seat.task, len(seat.containers)
    least = sum(_floor(policy, container) for container in seat.containers)
    if seat.weight.value == 0:
        return Claim(task.name, 0.0, least, least, pods)
    floor = max(least, -(-task.min // quantum))
    ceiling = (capacity if task.max is None else task.max) // quantum
    return Claim(task.name, seat.weight.value, floor, max(floor, ceiling), pods)


def _floor(policy: Policy, container: Container) -> int:
    """Units below which a container can't go: where only limits move, its request holds it up."""
    if policy.scheduler is Scheduler.REALTIME or policy.control is not Control.LIMIT:
        return 1
    return container.floor // QUANTUM


def _parts(policy: Policy, units: int, containers: list[Container]) -> list[tuple[Container, int]]:
    """One task's units over its containers on the node: equal parts above each one's own floor."""
    if len(containers) == 1:
        return [(containers[0], units)]
    parts = divide(units, [Claim(c.id, 1.0, floor := _floor(policy, c), max(floor, units)) for c in containers])
    return [(container, parts[container.id]) for container in containers]


def _floor_shortfall(capacity: int, quantum: int, claims: Sequence[Claim]) -> list[Shortfall]:
    if not floors_exceed(capacity // quantum, claims):
        return []
    total = sum(claim.floor for claim in claims) * quantum
    return [Shortfall("", f"the floors sum to {total}m, allowed: {capacity}m; all are scaled down")]
