"""The room that CPU requests leave on a node for tasks whose weights are requests. Pure; thousandths of a core.

The scheduler places pods by their requests, and a kubelet defers a resize whose request does not fit beside the others.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.cluster.container_names import container_id
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.policy.spec import Policy

    Original = Callable[[str, str], Cpu | None]

STEPS = 10_000
"""Requests are cut in parts of this if not all fit."""


class PodDemand(NamedTuple):
    """What a pod requests: `fixed` beside what policies move, which is `moved` if all fits, and `least` in any case."""

    fixed: int
    moved: float
    least: int

    @property
    def total(self) -> int:
        """What it takes of its node if no policy moves anything."""
        return max(self.fixed, self.least)

    def taken(self, step: int) -> float:
        """What it takes of its node if requests are cut to so many parts."""
        return max(self.fixed + self.moved * step / STEPS, self.least)


@dataclass(slots=True)
class Party:
    """A policy whose weights are requests: what these add up to by node, and what each is at most by container."""

    reference: str
    asked: dict[str, int] = field(default_factory=dict)
    moved: dict[str, float] = field(default_factory=dict)


def party(policy: Policy, containers: Iterable[Container], parts: Mapping[str, int]) -> Party:
    """The policy may weigh these `parts` of its nodes; the factor is as in `actuators.order.request_factors`."""
    most = {task.name: task.max for task in policy.tasks}
    here: dict[str, dict[str, int]] = defaultdict(dict)
    for one in filter(attrgetter("weighted"), containers):
        here[one.node][one.id] = most[one.task] or parts[one.node]
    found = Party(policy.reference)
    for node, own in here.items():
        total = max(1, sum(own.values()))
        found.asked[node] = min(parts[node], total)
        found.moved |= {identity: amount * found.asked[node] / total for identity, amount in own.items()}
    return found


def groups(policies: Sequence[Policy]) -> Iterator[list[Policy]]:
    """The policies whose weights may be requests, by whom each has to share with; the last group that names one counts.

    One that enforces nothing is looked at as if it did, and a shadow as if it stood in its model's place.
    """
    weighted = [policy for policy in policies if policy.enforcement.control is Control.WEIGHT]
    enforcing = [policy for policy in weighted if policy.mode.acts]
    for policy in weighted:
        if not policy.mode.acts:
            model = f"{policy.namespace}/{policy.shadow.of}" if policy.shadow else ""
            yield [*(one for one in enforcing if one.reference != model), policy]
    if enforcing:
        yield enforcing


def rooms(
    parties: Sequence[Party],
    nodes: Mapping[str, int],
    pods: Iterable[PodView],
    original: Original,
    arriving: Mapping[str, int],
) -> dict[str, dict[str, int]]:
    """What the requests of each party may add up to, by node; all on a node are cut by the same factor.

    `nodes` are those where requests are weights, with what admitted pods that are not among `pods` leave of them, and
    `arriving` is what others request there that no kubelet has admitted yet. Room is made for those as far as they fit
    beside what everybody requested before any policy: who may make pods could else take it from the parties.
    """
    moved = {identity: amount for own in parties for identity, amount in own.moved.items()}
    demands: dict[str, list[PodDemand]] = defaultdict(list)
    there, new = Counter[str](), Counter[str](arriving)
    for pod in pods:
        own = demand(pod, original, moved)
        if pod.admitted:
            there[pod.node] += demand(pod, original).total
        else:
            new[pod.node] += own.total
            own = PodDemand(0, own.moved, 0)
        demands[pod.node].append(own)
    fitting = {
        node: fit(left - min(new[node], max(0, left - there[node])), demands[node]) for node, left in nodes.items()
    }
    return {
        own.reference: {node: amount * fitting[node] // STEPS for node, amount in own.asked.items() if node in nodes}
        for own in parties
    }


def requested(pod: PodView) -> int:
    """What a pod takes of its node that no policy has to do with."""
    return demand(pod).total


def demand(pod: PodView, original: Original = lambda *_: None, moved: Mapping[str, float] | None = None) -> PodDemand:
    """What the pod requests. What a policy moved counts as it was before: the room must not depend on a plan."""
    if pod.ended and not pod.running:
        return PodDemand(0, 0.0, 0)
    moved = moved or {}
    names = {container_id(pod, container.name): container for container in pod.containers}
    others = [one for identity, one in names.items() if identity not in moved]
    fixed = sum([_fixed(one, original(pod.uid, one.name)) for one in others])
    own = sum([moved[identity] for identity in names.keys() & moved.keys()])
    return PodDemand(fixed + pod.overhead, own, pod.reserved + pod.overhead)


def _fixed(container: ContainerView, before: Cpu | None) -> int:
    """What it had before any policy, else what its kubelet makes room for."""
    return container.kept if before is None else before.request or 0


def fit(left: int, demands: Sequence[PodDemand]) -> int:
    """To how many parts what policies move must be cut, so that all pods fit into what is left of a node."""

    def taken(step: int) -> float:
        return round(sum([one.taken(step) for one in demands]), 6)  # parts of a sum that fits exactly must fit

    return STEPS if taken(STEPS) <= left else bisect_right(range(1, STEPS), float(left), key=taken)
