"""Which limits a container may have at all: what any plan of the policy gives it, or what it came with. Pure."""

from __future__ import annotations

from itertools import chain, combinations, product
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from tests.planning.builders import on_node
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    Readings = Mapping[str, Mapping[str, Any]]
    """The sample of each stream."""

TOLERANCE = 11
"""Thousandths of a core: of equal tasks any one may get the 10 that are left over, and the operator may be off by one
for a moment to make a restarted kubelet look."""


def plans(document: Mapping[str, Any], cores: float, readings: Iterable[Readings]) -> dict[str, set[int]]:
    """By task, each limit in thousandths of a core that some of the tasks' pods and some readings lead to."""
    policy = parsing.parse(document)
    names = [task.name for task in policy.tasks]
    subsets = chain.from_iterable(combinations(names, size) for size in range(1, len(names) + 1))
    found: dict[str, set[int]] = {name: set() for name in names}
    for present, sensed in product(list(subsets), list(readings)):
        planner = Planner(policy, Quiet(), {})
        planner.start(0.0)
        planner.handle(on_node(*present, cores=cores), 0.0)
        for stream, fields in sensed.items():
            planner.handle(Sample(stream, dict(fields), None), 0.1)
        planner.advance(1.0)
        for node in planner.last.nodes.values() if planner.last else ():
            for task, share in node.shares.items():
                found[task].add(share)
    return found


def wrong(limit: int, original: int, planned: set[int]) -> bool:
    """Whether nothing could have led to this limit."""
    return limit != original and not any(abs(limit - one) <= TOLERANCE for one in planned)
