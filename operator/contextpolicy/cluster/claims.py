"""Which policy and task each container belongs to, and which policy yields when two want the same. Pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.planning.placement import QUANTUM, Container, Placement
from contextpolicy.policy.spec import Control, Mode
from contextpolicy.policy.tenants import Tenants

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
    from contextpolicy.policy.spec import Policy, Task

    Original = Callable[[str, str], Cpu | None]


@dataclass(slots=True)
class Claim:
    """What one policy holds: its placement, and messages for the status."""

    placement: Placement
    conflicts: list[str] = field(default_factory=list)
    obstacles: dict[str, str] = field(default_factory=dict)
    realtime: list[str] = field(default_factory=list)
    unlimited: list[str] = field(default_factory=list)
    """Messages about nodes whose kernel can't limit CPU time, where orders have no effect."""
    agents: frozenset[str] = frozenset()
    shared: dict[str, str] = field(default_factory=dict)
    """By node, why the policy divides less of it than it could alone."""


def container_id(pod: PodView, container: str) -> str:
    """The name that planning uses for a container: unique, and the same after a restart of the operator."""
    return f"{pod.namespace}/{pod.name}/{container}"


def claim(
    policies: Sequence[Policy],
    pods: Iterable[PodView],
    nodes: Mapping[str, int],
    original: Original = lambda *_: None,
    tenants: Tenants | None = None,
) -> dict[str, Claim]:
    """What each policy gets, by reference. `policies` are ordered oldest first.

    Policies come in the order that `tenants` gives their namespaces, then by age. Each gets what those before it leave
    of a node, so that the limits never sum to more than the node has. Where namespaces of equal priority meet, none
    divides more than its own containers' limits add up to: a policy can't take from its neighbours what they had
    without any policy. `nodes` maps names to allocatable thousandths of a core, `original` a pod's UID and a
    container's name to what the container had before any policy. Only enforcing policies take anything.
    """
    tenants = tenants or Tenants()
    live: dict[str, list[PodView]] = defaultdict(list)
    for pod in sorted((pod for pod in pods if pod.node in nodes and not pod.ended), key=lambda pod: pod.name):
        live[pod.namespace].append(pod)
    ordered = sorted(policies, key=lambda policy: -tenants.priority(policy.namespace))
    found = [(policy, _find(policy, live[policy.namespace], original)) for policy in ordered]
    registry = _Registry(nodes, _equals(found, tenants))
    return {policy.reference: registry.admit(policy, matches) for policy, matches in found}


@dataclass(frozen=True, slots=True)
class _Match:
    """A container that a task selects, with the limit that it had before any policy."""

    task: Task
    container: Container
    limit: int
    obstacle: str | None


class _Registry:
    """What the policies that came first have taken. `equals`: see `_equals`."""

    def __init__(self, nodes: Mapping[str, int], equals: Mapping[tuple[str, str], frozenset[str]]) -> None:
        self._nodes, self._equals = nodes, equals
        self._owners: dict[str, str] = {}
        self._taken: dict[str, int] = defaultdict(int)
        self._takers: dict[str, list[str]] = defaultdict(list)

    def admit(self, policy: Policy, matches: Sequence[_Match]) -> Claim:
        result = Claim(Placement())
        held: dict[str, _Match] = {}
        for match in matches:
            identity, task = match.container.id, match.task.name
            owner = held[identity].task.name if identity in held else self._owners.get(identity)
            if owner is not None:
                result.conflicts.append(f"{identity} belongs to {owner}, task {task} can't have it too")
            elif match.obstacle is not None:
                result.obstacles[task] = match.obstacle
            else:
                held[identity] = match
        absent = {task.name for task in policy.leaves} - {match.task.name for match in matches}
        return self._take(policy, list(held.values()), frozenset(absent), result)

    def _take(self, policy: Policy, held: Sequence[_Match], absent: frozenset[str], result: Claim) -> Claim:
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
            if policy.mode is Mode.ENFORCE:
                self._taken[node] += share
                self._takers[node].append(policy.reference)
        containers = tuple(match.container for match in held if match.container.node in left)
        if policy.mode is Mode.ENFORCE:
            self._owners |= {c.id: f"task {c.task} of {policy.reference}" for c in containers}
        shared = {node: left[node] for node in result.shared}
        nodes = {node: self._nodes[node] for node in left}
        result.placement = Placement(nodes, containers, absent=absent, left=shared)
        return result

    def _share(self, policy: Policy, node: str, here: Iterable[_Match]) -> tuple[int, str]:
        """What the policy divides of a node, and why that is less than if it were alone there."""
        share, why = max(0, self._nodes[node] - policy.reserve), ""
        equals = self._equals.get((policy.reference, node))
        own = sum(match.limit for match in here)
        if equals and own < share:
            names = ", ".join(sorted(equals))
            share, why = own, f"node {node}: no priority says whether {policy.namespace} comes before {names}, so it "
            why += f"divides the {own}m that its containers' limits add up to"
        free = max(0, self._nodes[node] - self._taken[node])
        if free < share:
            share, why = free, f"node {node}: {', '.join(self._takers[node])} come first and leave {free}m of "
            why += f"{self._nodes[node]}m"
        return share, why


def _find(policy: Policy, pods: Sequence[PodView], original: Original) -> list[_Match]:
    """`pods` are those of the policy's own namespace: no other is its business."""
    found = []
    for task, pod, container in _matches(policy, pods):
        before = original(pod.uid, container.name)
        floor = pod.floor(container, before)
        claimed = Container(container_id(pod, container.name), task.name, pod.node, floor, container.memory_limit)
        limit = (before or container.spec).limit or 0
        found.append(_Match(task, claimed, limit, pod.obstacle(container, may_restart=task.restart_on_resize)))
    return found


def _equals(
    found: Iterable[tuple[Policy, Sequence[_Match]]], tenants: Tenants
) -> dict[tuple[str, str], frozenset[str]]:
    """By policy and node: the other namespaces of equal priority with enforcing policies on the node."""
    there: dict[tuple[str, int], set[str]] = defaultdict(set)
    places: list[tuple[Policy, str]] = []
    for policy, matches in found:
        for node in {match.container.node for match in matches if match.obstacle is None}:
            places.append((policy, node))
            if policy.mode is Mode.ENFORCE:
                there[node, tenants.priority(policy.namespace)].add(policy.namespace)
    return {
        (policy.reference, node): frozenset(there[node, tenants.priority(policy.namespace)] - {policy.namespace})
        for policy, node in places
    }


def _least(policy: Policy, container: Container) -> int:
    """The lowest limit that the container can get from the policy."""
    return container.floor if policy.control is Control.LIMIT else QUANTUM


def _matches(policy: Policy, pods: Sequence[PodView]) -> Iterator[tuple[Task, PodView, ContainerView]]:
    for task in policy.leaves:
        for pod in pods:
            if task.selector is not None and task.selector.matches(pod.labels):
                container = pod.container(task.container)
                if container is not None:
                    yield task, pod, container
