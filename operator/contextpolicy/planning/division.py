"""Weights and placement -> what each container gets, node by node (Eq. 1 and Eq. 2 with bounds)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.errors import ShareError
from contextpolicy.planning.plan import NodePlan, Shortfall
from contextpolicy.planning.seating import seat_tasks
from contextpolicy.planning.shares import Demand, divide, floors_exceed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.planning.placement import Placement
    from contextpolicy.planning.seating import Seat, SeatedNode, Seating
    from contextpolicy.planning.weights import Weight
    from contextpolicy.policy.spec import Policy


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
    claims: tuple[Demand, ...]


def divide_nodes(layout: Seating, weights: Mapping[str, Weight], last: Mapping[str, NodePlan]) -> Division:
    """Divide each node; a node that can't be divided keeps its last plan and says why."""
    nodes: dict[str, NodePlan] = {}
    shortfalls: list[Shortfall] = []
    for node in layout.nodes:
        claims = _claims(node, weights)
        try:
            nodes[node.name] = _divide(node, claims)
            shortfalls += _floor_shortfall(node, claims)
        except ShareError as error:
            shortfalls.append(Shortfall("", f"node {node.name} keeps its last plan: {error}"))
            if node.name in last:
                nodes[node.name] = last[node.name]
    return Division(nodes, tuple(shortfalls))


def terms(policy: Policy, weights: Mapping[str, Weight], placement: Placement) -> dict[str, Terms]:
    """Each node's terms, for explanations."""
    return {
        node.name: Terms(node.capacity, node.quantum, tuple(_claims(node, weights)))
        for node in seat_tasks(policy, placement).nodes
    }


def _claims(node: SeatedNode, weights: Mapping[str, Weight]) -> list[Demand]:
    return [seat.claim(weights[seat.task].value) for seat in node.seats]


def _divide(node: SeatedNode, claims: Sequence[Demand]) -> NodePlan:
    if not any(claim.weight > 0 for claim in claims):
        raise ShareError("the weights of all its tasks sum to 0, allowed: at least one above 0")
    units = divide(node.capacity // node.quantum, claims)
    shares = {name: units[name] * node.quantum for name in sorted(units)}
    containers: dict[str, int] = {}
    for seat in node.seats:
        if len(seat.containers) == 1:
            containers[seat.containers[0].id] = shares[seat.task]
        else:
            parts = _parts(seat, units[seat.task])
            containers |= {container: part * node.quantum for container, part in parts.items()}
    return NodePlan(node.capacity, shares, containers, node.scheduler)


def _parts(seat: Seat, units: int) -> dict[str, int]:
    """One task's units over its containers on the node: equal parts above each one's own floor."""
    claims = [
        Demand(container.id, 1.0, floor, max(floor, units))
        for container, floor in zip(seat.containers, seat.floors, strict=True)
    ]
    return divide(units, claims)


def _floor_shortfall(node: SeatedNode, claims: Sequence[Demand]) -> list[Shortfall]:
    if not floors_exceed(node.capacity // node.quantum, claims):
        return []
    total = sum(claim.floor for claim in claims) * node.quantum
    return [Shortfall("", f"the floors sum to {total}m, allowed: {node.capacity}m; all are scaled down")]
