"""Which policy and task each container belongs to, and which policy yields when two want the same. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.planning.placement import Container, Placement
from contextpolicy.policy.spec import Mode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
    from contextpolicy.policy.spec import Policy, Task


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


def container_id(pod: PodView, container: str) -> str:
    """The name that planning uses for a container: unique, and the same after a restart of the operator."""
    return f"{pod.namespace}/{pod.name}/{container}"


def claim(
    policies: Sequence[Policy],
    pods: Iterable[PodView],
    nodes: Mapping[str, int],
    original: Callable[[str, str], Cpu | None] = lambda *_: None,
) -> dict[str, Claim]:
    """What each policy gets, by reference. `policies` are ordered oldest first; an older policy keeps what it has.

    `nodes` maps names to allocatable thousandths of a core, `original` a pod's UID and a container's name to what the
    container had before any policy. A younger policy also yields a node where the capacities together exceed what the
    node has, so that the sum of limits never does. Only enforcing policies take anything.
    """
    live = sorted((pod for pod in pods if pod.node in nodes and not pod.ended), key=lambda p: (p.namespace, p.name))
    registry = _Registry(nodes, original)
    return {policy.reference: registry.admit(policy, live) for policy in policies}


class _Registry:
    """What older policies have taken already."""

    def __init__(self, nodes: Mapping[str, int], original: Callable[[str, str], Cpu | None]) -> None:
        self._nodes, self._original = nodes, original
        self._owners: dict[str, str] = {}
        self._taken: dict[str, int] = {}

    def admit(self, policy: Policy, pods: Sequence[PodView]) -> Claim:
        result = Claim(Placement())
        held: dict[str, Container] = {}
        absent = {task.name for task in policy.leaves}
        for task, pod, container in _matches(policy, pods):
            absent.discard(task.name)
            identity = container_id(pod, container.name)
            obstacle = pod.obstacle(container, may_restart=task.restart_on_resize)
            owner = held[identity].task if identity in held else self._owners.get(identity)
            if owner is not None:
                result.conflicts.append(f"{identity} belongs to {owner}, task {task.name} can't have it too")
            elif obstacle is not None:
                result.obstacles[task.name] = obstacle
            else:
                floor = pod.floor(container, self._original(pod.uid, container.name))
                held[identity] = Container(identity, task.name, pod.node, floor, container.memory_limit)
        return self._take(policy, list(held.values()), frozenset(absent), result)

    def _take(self, policy: Policy, held: list[Container], absent: frozenset[str], result: Claim) -> Claim:
        granted = []
        for node in sorted({container.node for container in held}):
            wanted, free = self._nodes[node] - policy.reserve, self._nodes[node] - self._taken.get(node, 0)
            if wanted > free:
                result.conflicts.append(_node_conflict(node, policy.reserve, self._nodes[node], free))
                continue
            granted.append(node)
            if policy.mode is Mode.ENFORCE:
                self._taken[node] = self._taken.get(node, 0) + wanted
        containers = tuple(container for container in held if container.node in granted)
        if policy.mode is Mode.ENFORCE:
            self._owners |= {c.id: f"task {c.task} of {policy.reference}" for c in containers}
        result.placement = Placement({node: self._nodes[node] for node in granted}, containers, absent=absent)
        return result


def _node_conflict(node: str, reserve: int, allocatable: int, free: int) -> str:
    return (
        f"node {node}: older policies leave {free}m of {allocatable}m; reserve {reserve}m is not allowed: "
        f"at least {allocatable - free}m"
    )


def _matches(policy: Policy, pods: Sequence[PodView]) -> Iterator[tuple[Task, PodView, ContainerView]]:
    for task in policy.leaves:
        for pod in pods:
            if pod.namespace == policy.namespace and task.selector is not None and task.selector.matches(pod.labels):
                container = pod.container(task.container)
                if container is not None:
                    yield task, pod, container
