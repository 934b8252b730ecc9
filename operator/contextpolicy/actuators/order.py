"""What one policy wants of its containers, whichever actuator makes it real. Pure."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.enforcement import amounts
from contextpolicy.policy.spec import Control, Scheduler, Transition

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import NodePlan
    from contextpolicy.policy.spec import Policy

_ALL: Mapping[str, int] = {}
"""Of each node all that is divided."""


@dataclass(frozen=True, slots=True)
class Order:
    """What one policy wants of its containers, all amounts in thousandths of a core.

    `claimed` are its containers, `nodes` maps each to its node. `shares` are the plan's, by container; `capacity` is
    N, by node. A claimed container without a share keeps what it has. `limits` are what a share means for a
    container's limit where that is not the share itself, None for the one it had before any policy; `requests` are
    what it means for its request, where requests are weights. `bounded`: the limits are what a node is divided by, so
    that they must not sum to more than `capacity`. On the nodes in `agents` an agent writes limits first, and resizes
    follow. `attended` are the nodes that have an agent, also one that does not write: when that ends, what it once
    wrote is undone.
    """

    policy: str
    claimed: frozenset[str]
    shares: Mapping[str, int] = field(default_factory=dict)
    capacity: Mapping[str, int] = field(default_factory=dict)
    limits: Mapping[str, int | None] = field(default_factory=dict)
    requests: Mapping[str, int] = field(default_factory=dict)
    bounded: bool = True
    nodes: Mapping[str, str] = field(default_factory=dict)
    transition: Transition = Transition.STRICT
    agents: frozenset[str] = frozenset()
    attended: frozenset[str] = frozenset()

    def leaves_alone(self, container: str) -> bool:
        """Whether the container, which has a share, keeps what it had before any policy."""
        return container not in self.requests and self.limits.get(container, 0) is None


def order_of(  # noqa: PLR0913 - all that an order depends on
    policy: Policy,
    containers: Collection[Container],
    nodes: Mapping[str, NodePlan],
    *,
    realtime: Collection[str] = (),
    agents: Collection[str] = (),
    attended: Collection[str] = (),
    room: Mapping[str, int] = _ALL,
) -> Order:
    """The order that makes the plans of `nodes` real; all `containers` are the policy's.

    Realtime nodes are left to the agent: their containers are not claimed, so limits that we moved are put back. Where
    there are `agents`, they write weights, and no request moves. `room`: see `request_factors`.
    """
    bounded = policy.enforcement.control is Control.LIMIT
    limits, requests = (
        ({}, {})
        if bounded
        else _limits_and_requests(policy, containers, nodes, request_factors(policy, containers, nodes, agents, room))
    )
    return Order(
        policy=policy.reference,
        claimed=frozenset([container.id for container in containers if container.node not in realtime]),
        shares={identity: share for node in nodes.values() for identity, share in node.containers.items()},
        capacity={name: node.capacity for name, node in nodes.items()},
        limits=limits,
        requests=requests,
        bounded=bounded,
        transition=policy.enforcement.transition,
        nodes={container.id: container.node for container in containers},
        agents=frozenset(agents),
        attended=frozenset(attended),
    )


def _limits_and_requests(
    policy: Policy, containers: Collection[Container], nodes: Mapping[str, NodePlan], factors: Mapping[str, float]
) -> tuple[dict[str, int | None], dict[str, int]]:
    tasks = {task.name: task for task in policy.tasks}
    limits: dict[str, int | None] = {}
    requests: dict[str, int] = {}
    for name, node in nodes.items():
        here = [container for container in containers if container.id in node.containers]
        count = Counter(container.task for container in here)
        for container in here:
            task = tasks[container.task]
            share, suspended = node.containers[container.id], task.name in node.suspended
            cap = node.caps.get(task.name) if node.caps else None
            weight, limits[container.id] = amounts(
                policy.enforcement.control, task, share, suspended=suspended, cap=cap, containers=count[task.name]
            )
            if weight is not None and container.weighted and name in factors:
                requests[container.id] = int(min(weight, limits[container.id] or node.capacity) * factors[name])
    return limits, requests


def request_factors(
    policy: Policy,
    containers: Collection[Container],
    nodes: Mapping[str, NodePlan],
    agents: Collection[str],
    room: Mapping[str, int] = _ALL,
) -> dict[str, float]:
    """What a weight is multiplied with to become a request, by node; only nodes where weights are requests.

    The scheduler and the kubelet keep room for requests, so even if each task were at its max they must fit into N,
    and into the `room` that other pods leave of the node where that is less. The factor does not depend on the plan:
    what counts is how requests compare, and no order of resizes can fail.
    """
    if policy.enforcement.control is not Control.WEIGHT:
        return {}
    most = {task.name: task.max for task in policy.tasks}
    factors = {}
    for name, node in nodes.items():
        if name not in agents and node.scheduler is Scheduler.CFS:
            weighted = [one for one in containers if one.weighted and one.id in node.containers]
            asked = sum(most[one.task] or node.capacity for one in weighted)
            factors[name] = min(1.0, min(node.capacity, room.get(name, node.capacity)) / max(1, asked))
    return factors
