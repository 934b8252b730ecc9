"""Tasks that claim the same container: certain if one selector implies the other, possible unless they exclude it."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.policy.selectors import Selector, SelectorRequirement
    from contextpolicy.policy.spec import Policy, Task


class TaskClaim(NamedTuple):
    """One task of one policy; `place` is its index in the policy."""

    policy: Policy
    place: int
    task: Task


class Overlap(NamedTuple):
    """Two claims; `certain` if one selector matches every pod that the other matches."""

    earlier: TaskClaim
    later: TaskClaim
    certain: bool


def overlaps(policies: Iterable[Policy]) -> Iterator[Overlap]:
    """Every pair of tasks that may claim the same container. Only policies in a mode that acts claim any."""
    claims = [
        TaskClaim(policy, place, task)
        for policy in policies
        if policy.mode.acts
        for place, task in enumerate(policy.tasks)
    ]
    for one, other in combinations(claims, 2):
        first, second = one.task.selector, other.task.selector
        if first is None or second is None or one.task.container != other.task.container:
            continue
        if one.policy.namespace == other.policy.namespace and not _exclude(first, second):
            yield Overlap(one, other, certain=_implies(first, second) or _implies(second, first))


def _implies(narrow: Selector, wide: Selector) -> bool:
    """Whether each requirement of `wide` follows from one of `narrow`."""
    return all(any(_follows(a, b) for a in narrow.requirements) for b in wide.requirements)


def _follows(given: SelectorRequirement, wanted: SelectorRequirement) -> bool:
    if given.key != wanted.key:
        return False
    match given.operator, wanted.operator:
        case "In", "In":
            return set(given.values) <= set(wanted.values)
        case "In", "NotIn":
            return not set(given.values) & set(wanted.values)
        case "NotIn", "NotIn":
            return set(wanted.values) <= set(given.values)
        # NotIn also matches pods without the label.
        case one, other:
            return one == other or (one, other) in {("In", "Exists"), ("DoesNotExist", "NotIn")}


def _exclude(first: Selector, second: Selector) -> bool:
    """Whether no pod can meet both."""
    return any(_contradict(a, b) or _contradict(b, a) for a in first.requirements for b in second.requirements)


def _contradict(one: SelectorRequirement, other: SelectorRequirement) -> bool:
    if one.key != other.key:
        return False
    match one.operator, other.operator:
        case "In", "In":
            return not set(one.values) & set(other.values)
        case "In", "NotIn":
            return set(one.values) <= set(other.values)
        case (("In" | "Exists"), "DoesNotExist"):
            return True
        case _:
            return False
