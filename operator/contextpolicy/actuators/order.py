"""What one policy wants of its containers, whichever actuator makes it real. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import Control, Transition

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import NodePlan
    from contextpolicy.policy.spec import Policy


@dataclass(frozen=True, slots=True)
class Order:
    """What one policy wants of its containers, all amounts in thousandths of a core.

    `claimed` are its containers, `nodes` maps each to its node. `shares` are the plan's, by container; `capacity` is N,
    by node. A claimed container without a share keeps what it has. `ceilings` are the limits where only weights move.
    """

    policy: str
    claimed: frozenset[str]
    shares: Mapping[str, int] = field(default_factory=dict)
    capacity: Mapping[str, int] = field(default_factory=dict)
    control: Control = Control.LIMIT
    ceilings: Mapping[str, int] = field(default_factory=dict)
    nodes: Mapping[str, str] = field(default_factory=dict)
    transition: Transition = Transition.STRICT


def order_of(
    policy: Policy, containers: Collection[Container], nodes: Mapping[str, NodePlan], realtime: Collection[str]
) -> Order:
    """The order that makes the plans of `nodes` real; all `containers` are the policy's.

    Realtime nodes are left to the agent: their containers are not claimed, so limits that we moved are put back.
    """
    ceilings = {task.name: task.max for task in policy.tasks}
    return Order(
        policy=policy.reference,
        claimed=frozenset([container.id for container in containers if container.node not in realtime]),
        shares={identity: share for node in nodes.values() for identity, share in node.containers.items()},
        capacity={name: node.capacity for name, node in nodes.items()},
        control=policy.control,
        transition=policy.transition,
        ceilings={c.id: ceilings[c.task] or nodes[c.node].capacity for c in containers if c.node in nodes},
        nodes={container.id: container.node for container in containers},
    )
