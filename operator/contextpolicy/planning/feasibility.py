"""Capability constraints against what the plan gives (paper III)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.planning.plan import Shortfall
from contextpolicy.policy.bandwidth import throttle_gap
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.planning.placement import Container
    from contextpolicy.planning.plan import NodePlan
    from contextpolicy.planning.weights import Weight
    from contextpolicy.policy.spec import Policy, Task


def shortfalls(
    policy: Policy, weights: Mapping[str, Weight], demanding: Iterable[Container], nodes: Mapping[str, NodePlan]
) -> Iterator[Shortfall]:
    """Every need that a running task has and does not get, and every request that keeps a limit up."""
    tasks = {task.name: task for task in policy.leaves} if demanding else {}
    for container in demanding:
        share = nodes[container.node].containers.get(container.id) if container.node in nodes else None
        if share is None:
            continue
        if weights[container.task].value > 0:
            yield from _unmet(tasks[container.task], share, container)
        elif policy.control is Control.LIMIT and share > 10:
            request = format_cpu(container.request)
            yield Shortfall(
                container.task,
                f"is suspended but its CPU request of {request} keeps its limit at {format_cpu(share)}",
            )


def _unmet(task: Task, share: int, container: Container) -> Iterator[Shortfall]:
    needs = task.needs
    if needs.cores is not None and share < needs.cores:
        yield Shortfall(task.name, f"needs {format_cpu(needs.cores)} cores, gets {format_cpu(share)}")
    if needs.memory is not None and container.memory is not None and container.memory < needs.memory:
        yield Shortfall(task.name, f"needs {needs.memory} bytes of memory, its limit is {container.memory}")
    gap = throttle_gap(share)
    if needs.deadline is not None and gap > needs.deadline:
        yield Shortfall(
            task.name,
            f"needs results within {needs.deadline:g} s, with {format_cpu(share)} it may stand still for {gap:.3g} s",
        )
