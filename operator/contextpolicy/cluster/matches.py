"""The containers that a policy's tasks select, what they had before, and what speaks against claiming them. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.parts import Stake
from contextpolicy.planning.allocation.placement import Container
from contextpolicy.policy.liveness_probes import probe_warning
from contextpolicy.policy.spec import Control, Scheduler

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
    from contextpolicy.policy.liveness_probes import ProbeWarning
    from contextpolicy.policy.spec import Policy, Task

    Original = Callable[[str, str], Cpu | None]

MOST_NAMED = 10
"""Containers that a message lists."""


@dataclass(frozen=True, slots=True)
class Match:
    """A container that a task selects, with the CPU that it had before any policy.

    An `obstacle` keeps it from being claimed; `unweighted` only says why a weight has no effect on it.
    """

    task: Task
    container: Container
    stake: Stake
    obstacle: str | None
    unweighted: str | None
    warning: ProbeWarning | None


def matches(policy: Policy, pods: Sequence[PodView]) -> Iterator[tuple[Task, PodView, ContainerView]]:
    """Each task with the pods and containers that it selects; `pods` are those of the policy's namespace."""
    for task in policy.leaves:
        for pod in pods:
            if task.selector is not None and task.selector.matches(pod.labels):
                container = pod.by_name.get(task.container)
                if container is not None:
                    yield task, pod, container


def examine(  # noqa: PLR0913, PLR0917 - as `claims.claim`
    policy: Policy,
    pods: Sequence[PodView],
    nodes: Mapping[str, int],
    original: Original,
    agents: Collection[str],
    doubt: Callable[[str], str | None],
    left: Callable[[str, str], int | None],
) -> list[Match]:
    """All matches of a policy; `pods` are those of its own namespace: no other is its business."""
    own = policy.enforcement
    weighted = own.control is Control.WEIGHT and own.scheduler is Scheduler.CFS
    found = []
    for task, pod, container in matches(policy, pods):
        before = original(pod.uid, container.name)
        floor = pod.floor(container, before)
        cpu, identity = before or container.spec, container_id(pod, container.name)
        claimed = Container(
            identity,
            task.name,
            pod.node,
            floor,
            container.memory_limit,
            cpu.limit,
            pod.qos == "Burstable",
            left=left(pod.uid, container.name),
        )
        obstacle = doubt(pod.uid) or pod.obstacle(
            container, may_restart=task.restart_on_resize, agent=pod.node in agents
        )
        if before is None:  # what is written down as the original has been granted
            obstacle = obstacle or pod.waits_for_request(container)
        unweighted = pod.unweighted(container) if weighted else None
        stake = Stake(_request(container, before), nodes[pod.node] if cpu.limit is None else cpu.limit)
        warning = probe_warning(policy, task, f"{pod.name}/{container.name}") if container.probed else None
        found.append(Match(task, claimed, stake, obstacle, unweighted, warning))
    return found


def _request(container: ContainerView, before: Cpu | None) -> int:
    """What it requested before any policy, as far as the kubelet granted it: anyone may write more."""
    if before is not None and before.request != container.spec.request:
        return before.request or 0
    return container.admitted


def misnamed(policy: Policy, pods: Sequence[PodView]) -> dict[str, str]:
    """By task, what its pods have instead of its container; `pods` are those of the policy's namespace."""
    found = {}
    for task in policy.leaves:
        own = [pod for pod in pods if task.selector is not None and task.selector.matches(pod.labels)]
        if own and not any(task.container in pod.by_name for pod in own):
            there = ", ".join(sorted({name for pod in own for name in pod.by_name})[:MOST_NAMED])
            found[task.name] = (
                f"task {task.name}: container: invalid value {task.container!r}: "
                f"expected one that its pods have, such as {own[0].name}: {there}"
            )
    return found
