"""Checks capability constraints against the shares of a plan (paper III)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.plan import Shortfall
from contextpolicy.planning.allocation.seating import holds_up
from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from collections.abc import Set as AbstractSet

    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import NodePlan
    from contextpolicy.planning.allocation.seating import SeatedNode, Seating
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.policy.spec import Policy, Task


def shortfalls(
    policy: Policy,
    weights: Mapping[str, Weight],
    suspended: AbstractSet[str],
    layout: Seating,
    nodes: Mapping[str, NodePlan],
) -> Iterator[Shortfall]:
    """Every unmet need of a running task, and every CPU request that holds a suspended task's limit up."""
    tasks = {task.name: task for task in policy.leaves} if layout.demanding else {}
    seated = {node.name: node for node in layout.nodes} if layout.demanding else {}
    for container in layout.demanding:
        share = nodes[container.node].containers.get(container.id) if container.node in nodes else None
        if share is None:
            continue
        if weights[container.task].value > 0:
            yield from _unmet(tasks[container.task], share, container, seated[container.node])
        elif container.task in suspended and holds_up(policy, tasks[container.task], container, layout.agents):
            request, limit = format_cpu(container.request), format_cpu(max(share, container.floor))
            yield Shortfall(container.task, f"is suspended but its CPU request of {request} keeps its limit at {limit}")


def _unmet(task: Task, share: int, container: Container, node: SeatedNode) -> Iterator[Shortfall]:
    needs, gap = task.needs, node.throttle_gap(share)
    if needs.cores is not None and share < needs.cores:
        yield Shortfall(task.name, f"needs {format_cpu(needs.cores)} cores, but gets {format_cpu(share)}")
    if needs.memory is not None and container.memory is not None and container.memory < needs.memory:
        yield Shortfall(task.name, f"needs {needs.memory} bytes of memory, but its limit is {container.memory}")
    if needs.deadline is not None and gap > needs.deadline:
        yield Shortfall(
            task.name, f"needs results within {needs.deadline:g} s, but with {share}m it may stall for {gap:.3g} s"
        )
