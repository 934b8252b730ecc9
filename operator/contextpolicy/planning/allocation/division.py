"""Weights and placement -> what each container gets, node by node (Eq. 1 and Eq. 2 with bounds)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.errors import ShareError
from contextpolicy.planning.allocation.plan import Basis, NodePlan, Shortfall
from contextpolicy.planning.allocation.shares import Demand, divide, floors_exceed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.planning.allocation.seating import Seat, SeatedNode, Seating
    from contextpolicy.planning.allocation.weights import Weight

    AtRest = Callable[[], Mapping[str, Weight]]


class Division(NamedTuple):
    """All nodes' plans, each task's share over all of them, and what could not be met.

    `resting` are the tasks that get a share by priority because nothing is active on their node. `claims` are what the
    nodes were divided by: the next division of the same layout starts from them.
    """

    nodes: Mapping[str, NodePlan]
    shares: Mapping[str, int]
    shortfalls: tuple[Shortfall, ...]
    resting: AbstractSet[str]
    claims: Mapping[str, Sequence[Demand]]


class Terms(NamedTuple):
    """What one node's division starts from: N, the step that shares move in, and each task's claim in steps."""

    capacity: int
    quantum: int
    claims: tuple[Demand, ...]
    basis: Basis = Basis.WEIGHT
    unprotected: bool = False
    """Whether the protected tasks' floors are more than there is, so that not even they can be kept."""


def divide_nodes(
    layout: Seating,
    weights: Mapping[str, Weight],
    last: Mapping[str, NodePlan],
    at_rest: AtRest,
    known: Mapping[str, Sequence[Demand]] | None = None,
) -> Division:
    """Divide each node; a node that can't be divided keeps its last plan and says why.

    `at_rest` returns what the tasks would weigh if all were active; called only for nodes where nothing is active.
    `known` are the claims of an earlier division of the same layout, if there was one.
    """
    nodes: dict[str, NodePlan] = {}
    claims: dict[str, Sequence[Demand]] = {}
    shortfalls: list[Shortfall] = []
    resting: set[str] = set()
    for node in layout.nodes:
        own = _terms(node, weights, at_rest, known.get(node.name, ()) if known else ())
        if not own.unprotected:
            claims[node.name] = own.claims
        try:
            nodes[node.name] = _divide(node, own)
            shortfalls += _floor_shortfalls(own)
            if own.basis is Basis.PRIORITY:
                resting.update(claim.name for claim in own.claims if claim.weight > 0)
        except ShareError as error:
            shortfalls.append(Shortfall("", f"node {node.name} keeps its last plan: {error}"))
            if node.name in last:
                nodes[node.name] = last[node.name]
    shares: dict[str, int] = {}
    for made in nodes.values():
        for name, share in made.shares.items():
            shares[name] = shares.get(name, 0) + share
    return Division(nodes, shares, tuple(shortfalls), resting, claims)


def terms(layout: Seating, weights: Mapping[str, Weight], at_rest: AtRest) -> dict[str, Terms]:
    """Each node's terms, for explanations."""
    return {node.name: _terms(node, weights, at_rest) for node in layout.nodes}


def _terms(node: SeatedNode, weights: Mapping[str, Weight], at_rest: AtRest, known: Sequence[Demand] = ()) -> Terms:
    basis = Basis.WEIGHT
    if not any(weights[seat.task].value > 0 for seat in node.seats):
        weights = at_rest()
        basis = Basis.PRIORITY if any(weights[seat.task].value > 0 for seat in node.seats) else Basis.NOTHING
    claims = node.claims(weights, known)
    unprotected = node.protects and sum(claim.least for claim in claims) > node.capacity // node.quantum
    if unprotected:
        # Not even the protected floors fit: scale them down with the others rather than keep an outdated plan.
        claims = [seat.claim(weights[seat.task].value, protect=False) for seat in node.seats]
    return Terms(node.capacity, node.quantum, tuple(claims), basis, unprotected)


def _divide(node: SeatedNode, own: Terms) -> NodePlan:
    units = divide(own.capacity // own.quantum, own.claims)
    shares = {name: units[name] * node.quantum for name in sorted(units)}
    containers: dict[str, int] = {}
    for seat in node.seats:
        if len(seat.containers) == 1:
            containers[seat.containers[0].id] = shares[seat.task]
        else:
            parts = _parts(seat, units[seat.task])
            containers |= {container: part * node.quantum for container, part in parts.items()}
    return NodePlan(node.capacity, shares, containers, node.scheduler, own.basis, caps=node.caps)


def _parts(seat: Seat, units: int) -> dict[str, int]:
    """One task's units over its containers on the node: equal parts above each one's own floor."""
    held = zip(seat.containers, seat.floors, strict=True)
    return divide(units, [Demand(container.id, 1.0, floor, units) for container, floor in held])


def _floor_shortfalls(own: Terms) -> list[Shortfall]:
    if not floors_exceed(own.capacity // own.quantum, own.claims):
        return []
    total = sum(claim.floor for claim in own.claims) * own.quantum
    scaled = "all are scaled down, including those of protected tasks" if own.unprotected else "all are scaled down"
    return [Shortfall("", f"the floors sum to {total}m, but the node has {own.capacity}m; {scaled}")]
