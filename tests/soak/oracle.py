"""Which limits a container may have at all: what any plan of the policy gives it, or what it came with. Pure."""

from __future__ import annotations

from itertools import chain, combinations, product
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.planner import Planner
from contextpolicy.planning.restart import Remembered
from contextpolicy.policy import parsing
from tests.planning.builders import on_node
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

    Readings = Mapping[str, Mapping[str, Any]]
    """The sample of each stream."""

TOLERANCE = 11
"""Thousandths of a core: of equal tasks any one may get the 10 that are left over, and the operator may be off by one
for a moment to make a restarted kubelet look."""


def plans(document: Mapping[str, Any], cores: float, readings: Iterable[Readings]) -> dict[str, set[int]]:
    """By task, each limit in thousandths of a core that some of the tasks' pods and some readings lead to.

    After a restart each task keeps its own last state until its streams are heard, and one whose pod came meanwhile has
    none to keep: for a moment any state of one task stands beside any state of another.
    """
    policy = parsing.parse(document)
    subsets = list(_subsets([task.name for task in policy.tasks]))
    every = [_plan(policy, cores, present, {}, sensed) for present, sensed in product(subsets, list(readings))]
    states = _states(every)
    mixtures = [dict(zip(states, mixture, strict=True)) for mixture in product(*states.values())]
    every += [_plan(policy, cores, present, mixture, {}) for present, mixture in product(subsets, mixtures)]
    found: dict[str, set[int]] = {task.name: set() for task in policy.tasks}
    for plan in every:
        for node in plan.nodes.values():
            for task, share in node.shares.items():
                found[task].add(share)
    return found


def _subsets(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    return chain.from_iterable(combinations(names, size) for size in range(1, len(names) + 1))


def _plan(
    policy: Policy, cores: float, present: Iterable[str], had: Mapping[str, Remembered], sensed: Readings
) -> Plan:
    """The plan once these readings are heard."""
    planner = Planner(policy, Quiet(), had)
    planner.start(0.0)
    planner.handle(on_node(*present, cores=cores), 0.0)
    for stream, fields in sensed.items():
        planner.handle(Sample(stream, dict(fields), None), 0.1)
    planner.advance(1.0)
    assert planner.last is not None
    return planner.last


def _states(every: Iterable[Plan]) -> dict[str, set[Remembered]]:
    """By task, every weight and suspension that it may remember."""
    found: dict[str, set[Remembered]] = {}
    for plan in every:
        for node in plan.nodes.values():
            for name in node.shares:
                task = plan.tasks[name]
                found.setdefault(name, set()).add(Remembered(task.weight, task.suspended))
    return found


def wrong(limit: int, original: int, planned: set[int]) -> bool:
    """Whether nothing could have led to this limit."""
    return limit != original and not any(abs(limit - one) <= TOLERANCE for one in planned)
