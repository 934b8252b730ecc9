"""Plans -> what a picture shows: steps per task and spans per context."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.planning.allocation.plan import Plan


def shares(plans: Sequence[Plan]) -> dict[str, list[tuple[float, float]]]:
    """Each task's share in cores; tasks without a container have none."""
    names = [
        name for name in _names(plans) if any(name in node.shares for plan in plans for node in plan.nodes.values())
    ]
    return {name: [(plan.time, plan.tasks[name].share / 1000) for plan in plans] for name in names}


def normalised_weights(plans: Sequence[Plan]) -> dict[str, list[tuple[float, float]]]:
    """Each task's weight as a fraction of the sum over the tasks that have a share."""
    names = list(shares(plans))
    sums = [sum(plan.tasks[name].weight for name in names) or 1.0 for plan in plans]
    return {
        name: [(plan.time, plan.tasks[name].weight / total) for plan, total in zip(plans, sums, strict=True)]
        for name in names
    }


def contexts(plans: Sequence[Plan], until: float) -> list[tuple[str, float, float]]:
    """Name, start and end of each span in which a context held, ordered by start."""
    spans: list[tuple[str, float, float]] = []
    since: dict[str, float] = {}
    for plan in plans:
        over = [name for name in since if name not in plan.contexts]
        spans += [(name, since.pop(name), plan.time) for name in over]
        for name in plan.contexts:
            since.setdefault(name, plan.time)
    return sorted([*spans, *((name, start, until) for name, start in since.items())], key=lambda span: span[1:])


def _names(plans: Sequence[Plan]) -> list[str]:
    return list(plans[0].tasks) if plans else []
