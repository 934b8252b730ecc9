"""From a policy's order to the resources that may be set on each pod now. Pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.headroom import Holding, prompt, strict
from contextpolicy.actuators.resize.takeover import LEAST_REQUEST
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Transition

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from contextpolicy.actuators.order import Order
    from contextpolicy.actuators.resize.originals import Original
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import ContainerView


@dataclass(frozen=True, slots=True)
class Target:
    """What the plan gives one container, and what it had `before` the plan; `stuck`: it can't be lowered for now.

    `spec` is what the API has now, None when that is unknown; `original` is what the container had before any policy.
    """

    id: str
    pod: TrackedPod
    container: ContainerView
    cpu: Cpu
    spec: Cpu | None
    before: Cpu
    original: Original | None
    stuck: bool = False

    @property
    def holding(self) -> Holding:
        """The container's limits as the headroom computation counts them."""
        name, state, wanted = self.container.name, self.pod.state, self.cpu.limit or 0
        return Holding(
            self.id, state.least_known(name), state.highest(name), wanted, self.before.limit or 0, stuck=self.stuck
        )


def target_cpu(
    order: Order, identity: str, pod: TrackedPod, container: ContainerView, original: Original | None
) -> Cpu:
    """The resources that the container's share means. Nothing sets a limit where there was none: it could never go.

    A Guaranteed pod keeps its class: request and limit stay equal, if it has these of its containers and not as a whole
    (`spec.resources`). A Burstable one does too: they stay apart.
    """
    ownership = pod.owned.get(container.name)
    before = original.cpu if original else ownership.cpu if ownership else container.spec
    wanted = order.limits.get(identity, order.shares[identity])
    if pod.view.qos == "Guaranteed" and before.limit is not None:
        limit = before.limit if wanted is None else wanted
        return Cpu(limit, limit)
    if before.limit is None or wanted is None:
        return Cpu(_request(order, identity, before, before.limit), before.limit)
    limit = wanted if identity in order.requests else max(wanted, pod.view.floor(container, before))
    return Cpu(_request(order, identity, before, limit), limit)


def _request(order: Order, identity: str, before: Cpu, limit: int | None) -> int | None:
    wanted = order.requests.get(identity)
    if wanted is None:
        return before.request
    return request_below(wanted, limit)


def request_below(wanted: int, limit: int | None) -> int:
    """The CPU request that a weight becomes: below the limit, so that the pod stays Burstable."""
    return max(LEAST_REQUEST, wanted if limit is None else min(wanted, limit - 1))


def steps(order: Order, targets: Iterable[Target], leaving: Mapping[str, int], now: float) -> dict[str, dict[str, Cpu]]:
    """The resources that differ from the plan and may be set now, by pod UID and container name.

    `leaving` is, by node, what pods that are being deleted still have from the policy: it is not free until their
    containers have ended.
    """
    by_node: dict[str, list[Target]] = defaultdict(list)
    for target in targets:
        by_node[target.pod.view.node].append(target)
    found: dict[str, dict[str, Cpu]] = defaultdict(dict)
    unseen = _unseen(order, by_node)
    for node, here in by_node.items():
        # A container that the watch has not shown yet may have any limit: until it does, nothing on its node rises.
        capacity = 0 if unseen & {node, ""} else order.capacity.get(node, 0) - leaving.get(node, 0)
        go, back = _chosen(order, capacity, here)
        for target in here:
            pod, name = target.pod, target.container.name
            step = target.before if target.id in back else pod.step(target.container, target.cpu, target.spec, now)
            if target.id in go | back and step != target.spec and now >= pod.rests_until(name):
                found[pod.uid][name] = step
    return found


def _chosen(order: Order, capacity: int, targets: Sequence[Target]) -> tuple[set[str], set[str]]:
    """The containers of a node that may get their share now, and those that must go back to what they had before."""
    if not order.bounded:
        return {target.id for target in targets}, set()
    holdings = [target.holding for target in targets]
    if order.transition is Transition.STRICT:
        return strict(capacity, holdings), set()
    return prompt(capacity, holdings)


def _unseen(order: Order, by_node: Mapping[str, Iterable[Target]]) -> set[str]:
    """The nodes of containers that have a share but were not seen on the watch yet; "" when the node is unknown."""
    seen = {target.id for targets in by_node.values() for target in targets}
    return {order.nodes.get(identity, "") for identity in (order.shares.keys() & order.claimed) - seen}
