"""From a policy's order to what may be asked of each pod now. Pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.headroom import Holding, prompt, strict
from contextpolicy.actuators.resize.patches import cpu_for
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Control, Transition

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from contextpolicy.actuators.order import Order
    from contextpolicy.actuators.resize.originals import Original
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import ContainerView


@dataclass(frozen=True, slots=True)
class Wish:
    """What the plan gives one container, and what it had `before` the plan came; `stuck` if it won't be lowered."""

    id: str
    pod: TrackedPod
    container: ContainerView
    cpu: Cpu
    before: Cpu
    stuck: bool = False

    @property
    def holding(self) -> Holding:
        """Its limits as the node's headroom counts them."""
        name, state, wanted = self.container.name, self.pod.state, self.cpu.limit or 0
        return Holding(
            self.id, state.least_known(name), state.highest(name), wanted, self.before.limit or 0, stuck=self.stuck
        )


def wanted_cpu(
    order: Order, identity: str, pod: TrackedPod, container: ContainerView, original: Original | None
) -> Cpu:
    """The resources that the container's share means; where only limits move, with the request it had before us."""
    share = order.shares[identity]
    cpu = cpu_for(pod.view, container, share, order.control, order.ceilings.get(identity, share))
    ownership = pod.owned.get(container.name)
    before = original.cpu if original else ownership.cpu if ownership else None
    if before is None or order.control is not Control.LIMIT or pod.view.qos == "Guaranteed":
        return cpu
    return Cpu(before.request, cpu.limit)


def steps(order: Order, wishes: Iterable[Wish], leaving: Mapping[str, int], now: float) -> dict[str, dict[str, Cpu]]:
    """What differs from the plan and may be set now, by pod UID.

    `leaving` is what the policy gave to pods of each node that are being deleted: it is theirs until their containers
    have ended.
    """
    by_node: dict[str, list[Wish]] = defaultdict(list)
    for wish in wishes:
        by_node[wish.pod.view.node].append(wish)
    found: dict[str, dict[str, Cpu]] = defaultdict(dict)
    unseen = _unseen(order, by_node)
    for node, here in by_node.items():
        # A container that we have not seen yet may hold anything: until then nothing rises beside it.
        capacity = 0 if unseen & {node, ""} else order.capacity.get(node, 0) - leaving.get(node, 0)
        go, back = _chosen(order, capacity, here)
        for wish in here:
            name, state = wish.container.name, wish.pod.state
            step = wish.before if wish.id in back else wish.pod.step(wish.container, wish.cpu, now)
            if wish.id in go | back and step != state.spec(name) and now >= wish.pod.rests_until(name):
                found[wish.pod.view.uid][name] = step
    return found


def _chosen(order: Order, capacity: int, wishes: Sequence[Wish]) -> tuple[set[str], set[str]]:
    """The containers of a node that may have what is wanted now, and those that go back to what they had before."""
    if order.control is Control.WEIGHT:
        return {wish.id for wish in wishes}, set()
    holdings = [wish.holding for wish in wishes]
    return (strict(capacity, holdings), set()) if order.transition is Transition.STRICT else prompt(capacity, holdings)


def _unseen(order: Order, by_node: Mapping[str, Iterable[Wish]]) -> set[str]:
    """The nodes of containers that the plan counts on and the watch has not shown; empty text where nobody knows."""
    seen = {wish.id for wishes in by_node.values() for wish in wishes}
    return {order.nodes.get(identity, "") for identity in (order.shares.keys() & order.claimed) - seen}
