"""The planner beside the reference model: where they differ, and the least of a story that shows it."""

from __future__ import annotations

import ast
import copy
import math
from dataclasses import replace
from datetime import UTC, datetime
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone
from contextpolicy.planning.planner import Planner
from contextpolicy.planning.restart import Remembered
from contextpolicy.policy import parsing
from tests.oracle.model import seen
from tests.oracle.story import Version
from tests.oracle.units import HALF, in_seconds
from tests.planning.builders import a_body, on_node
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.policy.spec import Policy
    from tests.oracle.model import Seen
    from tests.oracle.story import Story

START = 600.0
"""Sums with it are exact, and far from a power of two."""


def difference(story: Story) -> str | None:
    """The first one in words; None where planner and model agree at every moment."""
    for expected, planner in zip(seen(story), planned(story), strict=True):
        reported = _difference(expected, planner)
        if reported:
            return reported
    return None


def planned(story: Story) -> Iterator[Planner]:
    """The planner at the end of each instant, and just after it."""
    planner = None
    happenings = list(story.happenings)
    for at in story.instants():
        now = START + in_seconds(at)
        while planner is not None and happenings and happenings[0].at == at:
            one = happenings.pop(0)
            event = Gone(one.stream) if one.fields is None else Sample(one.stream, dict(one.fields))
            planner.handle(event, now)
        if planner is not None:
            planner.advance(now)
        for version in story.versions:
            if version.at == at:
                planner = _begun(policy_of(version), planner, now, story)
        assert planner is not None
        yield planner
        if story.has_ages:
            planner.advance(now + in_seconds(HALF) / 2)
            yield planner


def policy_of(version: Version) -> Policy:
    return _parsed(repr(version.spec))


@lru_cache(maxsize=8)
def _parsed(source: str) -> Policy:
    spec: dict[str, Any] = ast.literal_eval(source)
    if "force" in spec:
        until = datetime.fromtimestamp(START + in_seconds(spec["force"]["until"]), tz=UTC)
        spec["force"]["until"] = until.isoformat(timespec="microseconds")
    return parsing.parse(a_body(**spec))


def _begun(policy: Policy, before: Planner | None, now: float, story: Story) -> Planner:
    planner = Planner(policy, Quiet(), {name: Remembered(*own) for name, own in story.remembered.items()})
    planner.start(now, before)
    planner.handle(on_node(*(task.name for task in policy.leaves), cores=story.cores), now)
    return planner


def _difference(expected: Seen, planner: Planner) -> str | None:
    plan = planner.last
    if plan is None:
        return f"{_when(expected.at)}: there is no plan, expected one"
    tasks = plan.tasks
    suspended = {name for name in expected.shares if tasks[name].suspended}
    reported = [
        _unlike("contexts", plan.contexts, expected.contexts),
        *(_unlike(f"score of {name}", tasks[name].score, score) for name, score in expected.scores.items()),
        *(_unlike(f"weight of {name}", tasks[name].weight, weight) for name, weight in expected.weights.items()),
        _unlike("suspended", sorted(suspended), sorted(expected.suspended)),
        *(_unlike(f"share of {name}", tasks[name].share, share) for name, share in expected.shares.items()),
    ]
    found = next(filter(None, reported), None)
    return f"{_when(expected.at)}: {found}" if found else None


def _unlike(what: str, is_: object, expected: object) -> str | None:
    if isinstance(is_, float) and isinstance(expected, Fraction):
        alike = math.isclose(is_, expected, rel_tol=1e-9, abs_tol=1e-12)
        return None if alike else f"{what} is {is_:g}, expected {float(expected):g}"
    return None if is_ == expected else f"{what} is {is_}, expected {expected}"


def _when(at: int) -> str:
    return f"{'just after ' if at % 2 else ''}{in_seconds(at - at % 2):g} s"


def least(story: Story) -> Story:
    """What is left of a story that shows a difference when nothing more can be taken away."""
    shrunk = True
    while shrunk:
        shrunk = False
        for smaller in _smaller(story):
            if _still_differs(smaller):
                story, shrunk = smaller, True
                break
    return story


def _still_differs(story: Story) -> bool:
    try:
        return difference(story) is not None
    except (PolicyError, KeyError, StopIteration):
        return False


def _smaller(story: Story) -> Iterator[Story]:
    if len(story.versions) > 1:
        yield replace(story, versions=story.versions[:1])
        yield replace(story, versions=[Version(0, story.versions[1].spec)])
    for name in story.remembered:
        yield replace(story, remembered={one: own for one, own in story.remembered.items() if one != name})
    for number in range(len(story.happenings)):
        yield replace(story, happenings=_without(story.happenings, number))
    # The same part goes from all versions: an edit is what they differ in.
    for path in sorted({path for version in story.versions for path in _parts(version.spec)}, key=len):
        versions = [Version(one.at, _cut(one.spec, path)) for one in story.versions]
        if versions != list(story.versions):
            yield replace(story, versions=versions)


def _parts(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, inner in items:
        if name not in {"selector", "name", "key"}:
            yield from _parts(inner, (*path, name))


def _cut(spec: Mapping[str, Any], path: Sequence[str | int]) -> dict[str, Any]:
    new: Any = copy.deepcopy(dict(spec))
    at = new
    try:
        for name in path[:-1]:
            at = at[name]
        del at[path[-1]]
    except (KeyError, IndexError, TypeError):
        return dict(spec)
    return new  # type: ignore[no-any-return]


def _without(items: Sequence[Any], place: int) -> list[Any]:
    return [item for number, item in enumerate(items) if number != place]
