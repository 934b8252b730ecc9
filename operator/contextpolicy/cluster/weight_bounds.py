"""What the weights of policies may add up to on a node, so that all other pods keep what they request. Pure.

Contested CPU is divided by weight, and a pod that no policy weighs has its request as its weight. So if all weights of
a node fit into it together, who wants it gets at least its own weight. All amounts are thousandths of a core.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.parts import Stake, parts

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.tenants import Tenants

    Held = tuple[Iterable[Container], Mapping[str, int]]
    """The containers of a policy, and what it divides of their nodes."""

_NOTHING: Mapping[str, int] = {}
_NONE: Collection[str] = frozenset()


class Weighed(NamedTuple):
    """A policy whose containers have weights: what they request and what it divides, together, by node."""

    namespace: str
    containers: frozenset[str]
    stakes: Mapping[str, Stake]


def most_weights(  # noqa: PLR0913, PLR0917 - all that weights share a node with
    group: Sequence[Policy],
    held: Mapping[str, Held],
    requests: Mapping[str, int],
    tenants: Tenants,
    free: Mapping[str, int],
    pods: Sequence[PodView],
) -> dict[str, dict[str, int]]:
    """What the weights of each policy of a group that shares nodes (`room.groups`) may add up to, by node.

    Namespaces come in the order that `tenants` gives them, equals by their requests; each leaves what everybody after
    it and everybody without weights requests, and none has less than its own containers request. `requests` are what
    containers had before any policy, by container; `free` is what pods that are not among `pods` leave of each node.
    """
    weighed = {one.reference: _weighed(one, *held[one.reference], requests) for one in group}
    ours = {identity for one in weighed.values() for identity in one.containers}
    left = Counter(free)
    for pod in pods:
        left[pod.node] -= granted(pod, requests, ours)
    found: dict[str, dict[str, int]] = {reference: {} for reference in weighed}
    for node in free:
        here = {reference: one for reference, one in weighed.items() if node in one.stakes}
        for reference, most in _on_node(node, left[node], here, tenants).items():
            found[reference][node] = most
    return found


def granted(pod: PodView, requests: Mapping[str, int] = _NOTHING, but: Collection[str] = _NONE) -> int:
    """What a pod weighs beside its containers `but`: the request that its kubelet has granted, before any policy.

    Who may make pods may request anything, on any node: what no kubelet has admitted weighs nothing.
    """
    if not pod.admitted:
        return 0
    admitted = {container_id(pod, one.name): one.admitted for one in pod.containers}
    own = sum(requests.get(identity, amount) for identity, amount in admitted.items() if identity not in but)
    return pod.overhead + (max(own, pod.reserved) if admitted.keys().isdisjoint(but) else own)


def _weighed(
    policy: Policy, containers: Iterable[Container], divided: Mapping[str, int], requests: Mapping[str, int]
) -> Weighed:
    own = {one.id: one.node for one in filter(attrgetter("weighted"), containers)}
    asked: Counter[str] = Counter(dict.fromkeys(own.values(), 0))
    for identity, node in own.items():
        asked[node] += requests[identity]
    return Weighed(policy.namespace, frozenset(own), {node: Stake(asked[node], divided[node]) for node in asked})


def _on_node(node: str, left: int, here: Mapping[str, Weighed], tenants: Tenants) -> dict[str, int]:
    """By policy; those of a namespace have its part in proportion to what they divide."""
    stakes: dict[str, Stake] = defaultdict(Stake)
    for one in here.values():
        stakes[one.namespace] += one.stakes[node]
    most = _by_namespace(left, stakes, {namespace: tenants.priority(namespace) for namespace in stakes})
    return {
        reference: most[one.namespace] * one.stakes[node].limit // max(1, stakes[one.namespace].limit)
        for reference, one in here.items()
    }


def _by_namespace(left: int, stakes: Mapping[str, Stake], priorities: Mapping[str, int]) -> dict[str, int]:
    found: dict[str, int] = {}
    after = sum(_own(stake) for stake in stakes.values())
    for priority in sorted(set(priorities.values()), reverse=True):
        equals = {namespace: stake for namespace, stake in stakes.items() if priorities[namespace] == priority}
        after -= sum(_own(stake) for stake in equals.values())
        shared = parts(max(0, left - after), equals)
        found |= {namespace: max(shared[namespace], _own(stake)) for namespace, stake in equals.items()}
        left -= sum(found[namespace] for namespace in equals)
    return found


def _own(stake: Stake) -> int:
    """What it has without any policy, of what it divides."""
    return min(stake)
