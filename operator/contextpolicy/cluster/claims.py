"""Which policy and task each container belongs to, and which policy yields when two want the same. Pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.cluster.matches import examine, misnamed
from contextpolicy.cluster.parts import Stake, parts
from contextpolicy.cluster.room import groups, party, rooms
from contextpolicy.cluster.weight_bounds import most_weights
from contextpolicy.planning.allocation.placement import QUANTUM, Placement
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.matches import Match, Original
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.tenants import Tenants

_NOTHING: Mapping[str, int] = {}


@dataclass(slots=True)
class Claim:
    """What one policy holds: its placement, and messages for the status."""

    placement: Placement
    conflicts: list[str] = field(default_factory=list)
    obstacles: dict[str, str] = field(default_factory=dict)
    """By task, why containers of it are not claimed, or can't have all that the policy's control means."""
    misnamed: dict[str, str] = field(default_factory=dict)
    """By task, which containers its pods have where none has the name that the task says."""
    warnings: dict[str, str] = field(default_factory=dict)
    """By task, what may go wrong although it is claimed."""
    realtime: list[str] = field(default_factory=list)
    unlimited: list[str] = field(default_factory=list)
    """Messages about nodes whose kernel can't limit CPU time, and containers whose weights can't be written."""
    agents: frozenset[str] = frozenset()
    """The nodes whose agents write limits and weights."""
    attended: frozenset[str] = frozenset()
    """The nodes that have an agent, whatever it can do."""
    shared: dict[str, str] = field(default_factory=dict)
    """By node, why the policy divides less of it than it could alone."""
    room: dict[str, int] = field(default_factory=dict)
    """What the requests of its containers may add up to beside those of others, by node where weights are requests."""
    most_weight: dict[str, int] = field(default_factory=dict)
    """What the weights of its containers may add up to, by node: all others keep what they request."""


def claim(  # noqa: PLR0913 - all that a claim depends on
    policies: Sequence[Policy],
    pods: Iterable[PodView],
    nodes: Mapping[str, int],
    original: Original,
    tenants: Tenants,
    *,
    agents: Collection[str] = (),
    elsewhere: Mapping[str, int] = _NOTHING,
    weighing: Mapping[str, int] = _NOTHING,
    doubt: Callable[[str], str | None] = lambda _: None,
    left: Callable[[str, str], int | None] = lambda *_: None,
) -> dict[str, Claim]:
    """What each policy gets, by reference. `policies` are ordered oldest first.

    Policies come in the order that `tenants` gives their namespaces, then by age. Each gets what those before it leave
    of a node, so that the limits never sum to more than the node has. Where namespaces of equal priority meet, none
    divides more than its own containers' limits add up to, nor more than its part in proportion to their requests if
    these don't fit together: so no neighbour takes from a namespace what it would have without any policy, whatever
    limits it writes. Only enforcing policies take anything.

    A shadow is placed as if it stood where the policy is that it is a shadow of.

    `nodes` maps names to allocatable thousandths of a core, `original` a pod's UID and a container's name to what the
    container had before any policy. `agents` are the nodes whose agents write limits; `elsewhere` is what pods that are
    not among `pods` request, by node, and `weighing` what of that kubelets have granted. `doubt` says of a pod's UID
    why it must be left alone, if it must, `left` of a UID and a container's name which limit another writer insists on.
    """
    pods = list(pods)
    live = _live(pods, nodes)
    ordered = sorted(policies, key=lambda policy: -tenants.priority(policy.namespace))
    found = [
        (policy, examine(policy, live[policy.namespace], nodes, original, agents, doubt, left))
        for policy in _with_shadows(ordered)
    ]
    registry = _Registry(nodes, tenants, _owned(found, tenants))
    placed = {policy.reference: registry.admit(policy, matches) for policy, matches in found}
    held = {reference: (own.placement.containers, registry.parts[reference]) for reference, own in placed.items()}
    free = {node: size - weighing.get(node, 0) for node, size in nodes.items() if node not in agents}
    arriving = {node: max(0, amount - weighing.get(node, 0)) for node, amount in elsewhere.items()}
    requests = {match.container.id: match.stake.request for _, matches in found for match in matches}
    beside = {node: size - weighing.get(node, 0) for node, size in nodes.items()}
    for group in groups([policy for policy, _ in found]):
        most = most_weights(group, held, requests, tenants, beside, pods)
        parties = [party(one, held[one.reference][0], most[one.reference]) for one in group]
        room = rooms(parties, free, pods, original, arriving)
        for one in group:
            placed[one.reference].most_weight, placed[one.reference].room = most[one.reference], room[one.reference]
    for policy, _ in found:
        placed[policy.reference].misnamed = misnamed(policy, live[policy.namespace])
    return {policy.reference: placed.get(policy.reference) or _alone(policy, policies) for policy in policies}


def _live(pods: Iterable[PodView], nodes: Collection[str]) -> Mapping[str, list[PodView]]:
    """By namespace, the pods that run on these nodes."""
    live: dict[str, list[PodView]] = defaultdict(list)
    for pod in sorted((pod for pod in pods if pod.node in nodes and not pod.ended), key=lambda pod: pod.name):
        live[pod.namespace].append(pod)
    return live


def _with_shadows(policies: Sequence[Policy]) -> Iterator[Policy]:
    """Each policy after its shadows, so that these find the node as it does; shadows of nothing are left out."""
    shadows = defaultdict(list)
    for policy in policies:
        if policy.shadow is not None:
            shadows[policy.namespace, policy.shadow.of].append(policy)
    for policy in policies:
        if policy.shadow is None:
            yield from shadows.get((policy.namespace, policy.name), ())
            yield policy


def _alone(shadow: Policy, policies: Iterable[Policy]) -> Claim:
    """The claim of a shadow without the policy that it is to be compared with."""
    there = [one.name for one in policies if one.namespace == shadow.namespace and one.shadow is None]
    of, known = shadow.shadow.of if shadow.shadow else "", f": one of {', '.join(there)}" if there else "; none runs"
    problem = f"spec.shadow.of: invalid value {of!r}: expected a running policy of namespace {shadow.namespace}{known}"
    return Claim(Placement(), conflicts=[problem])


class _Registry:
    """What the policies that came first have taken. `owned`: see `_owned`."""

    def __init__(
        self, nodes: Mapping[str, int], tenants: Tenants, owned: Mapping[tuple[str, int], Mapping[str, Stake]]
    ) -> None:
        self._nodes, self._tenants, self._owned = nodes, tenants, owned
        self._before: dict[tuple[str, int], int] = {}
        """By node and priority, what greater priorities leave."""
        self._used: dict[tuple[str, str], int] = defaultdict(int)
        """By node and namespace."""
        self._owners: dict[str, str] = {}
        self._taken: dict[str, int] = defaultdict(int)
        self._takers: dict[str, list[str]] = defaultdict(list)
        self.parts: dict[str, Mapping[str, int]] = {}
        """By policy, what it divides of each node."""

    def admit(self, policy: Policy, matches: Sequence[Match]) -> Claim:
        result = Claim(Placement())
        held: dict[str, Match] = {}
        for match in matches:
            identity, task = match.container.id, match.task.name
            owner = held[identity].task.name if identity in held else self._owners.get(identity)
            if owner is not None:
                result.conflicts.append(f"{identity} belongs to {owner}; task {task} can't claim it too")
            elif match.obstacle is not None:
                result.obstacles[task] = match.obstacle
            else:
                held[identity] = match
                if match.unweighted is not None:
                    result.obstacles[task] = match.unweighted
                if match.warning is not None:
                    result.warnings[task] = str(match.warning)
        absent = {task.name for task in policy.leaves} - {match.task.name for match in matches}
        return self._take(policy, list(held.values()), frozenset(absent), result)

    def _take(self, policy: Policy, held: Sequence[Match], absent: frozenset[str], result: Claim) -> Claim:
        left: dict[str, int] = {}
        for node in sorted({match.container.node for match in held}):
            here = [match for match in held if match.container.node == node]
            share, why = self._share(policy, node, here)
            least = sum(_least(policy, match.container) for match in here)
            if why and share < least:
                result.conflicts.append(f"{why}; its containers there need at least {least}m")
                continue
            left[node] = share
            if why:
                result.shared[node] = why
            if policy.mode.acts:
                self._taken[node] += share
                self._used[node, policy.namespace] += share
                self._takers[node].append(policy.reference)
        containers = tuple(match.container for match in held if match.container.node in left)
        if policy.mode.acts:
            self._owners |= {c.id: f"task {c.task} of {policy.reference}" for c in containers}
        self.parts[policy.reference] = left
        shared = {node: left[node] for node in result.shared}
        nodes = {node: self._nodes[node] for node in left}
        result.placement = Placement(nodes, containers, absent=absent, left=shared)
        return result

    def _share(self, policy: Policy, node: str, here: Iterable[Match]) -> tuple[int, str]:
        """What the policy divides of a node, and why that is less than if it were alone there."""
        share, why = max(0, self._nodes[node] - policy.reserve), ""
        rivals, part = self._part(policy, node, _sum(match.stake for match in here))
        if rivals and part < share:
            share, why = part, f"node {node}: {policy.namespace} and {rivals} have equal priority, so this policy "
            why += f"divides {part}m: the sum of its containers' limits, "
            why += "or its portion by requests where those don't fit"
        free = max(0, self._nodes[node] - self._taken[node])
        if free < share:
            share, why = free, f"node {node}: {', '.join(self._takers[node])} come first and leave {free}m of "
            why += f"{self._nodes[node]}m"
        return share, why

    def _part(self, policy: Policy, node: str, own: Stake) -> tuple[str, int]:
        """The other namespaces of equal priority on a node, and what is left of the policy's part beside them."""
        priority, namespace = self._tenants.priority(policy.namespace), policy.namespace
        before = self._before.setdefault((node, priority), max(0, self._nodes[node] - self._taken[node]))
        owned = {namespace: own, **self._owned.get((node, priority), {})}
        part = parts(before, owned)[namespace] - self._used[node, namespace]
        return ", ".join(sorted(owned.keys() - {namespace})), max(0, min(own.limit, part))


def _owned(
    found: Iterable[tuple[Policy, Sequence[Match]]], tenants: Tenants
) -> dict[tuple[str, int], dict[str, Stake]]:
    """By node and priority: what each namespace's containers under enforcing policies have together."""
    stakes: dict[tuple[str, int], dict[str, dict[str, Stake]]] = defaultdict(lambda: defaultdict(dict))
    for policy, matches in found:
        for match in matches:
            if match.obstacle is None and policy.mode.acts:
                place = match.container.node, tenants.priority(policy.namespace)
                stakes[place][policy.namespace][match.container.id] = match.stake
    return {
        place: {namespace: _sum(own.values()) for namespace, own in there.items()} for place, there in stakes.items()
    }


def _sum(stakes: Iterable[Stake]) -> Stake:
    return sum(stakes, Stake())


def _least(policy: Policy, container: Container) -> int:
    """The lowest limit that the container can get from the policy."""
    return container.floor if policy.enforcement.control is Control.LIMIT else QUANTUM
