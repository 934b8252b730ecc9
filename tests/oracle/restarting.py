"""What a restarted operator leaves alone: the reference model's reading."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from tests.oracle.language import contexts_in, streams_in
from tests.oracle.weighing import Weights

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from collections.abc import Set as AbstractSet

    from tests.oracle.story import Memory

EXPRESSIONS = ("when", "until", "scoreFrom")


def reads_of(spec: Mapping[str, Any]) -> dict[str, frozenset[str]]:
    """For each task the streams by which it may change: its own, those of contexts, and those of tasks around it."""
    own = {task["name"]: _own_reads(spec, task) for task in spec["tasks"]}
    return {name: frozenset().union(*(own[one] for one in _around(spec, name))) for name in own}


def tasks_moved_by(spec: Mapping[str, Any], contexts: AbstractSet[str]) -> set[str]:
    """The tasks that these contexts change, or a task around them."""
    named = {
        task for context in spec.get("contexts", ()) if context["name"] in contexts for task in context.get("tasks", {})
    }
    return {task["name"] for task in spec["tasks"] if named & _around(spec, task["name"])}


def as_before(weights: Weights, kept: Mapping[str, Memory]) -> Weights:
    """These tasks weigh what they weighed, whatever keeps them from running now."""
    value = {name: Fraction(str(own.weight)) for name, own in kept.items()}
    suspended = frozenset(name for name, own in kept.items() if own.suspended)
    return Weights({**weights.value, **value}, weights.unable.difference(value) | suspended)


def at_rest_as_before(spec: Mapping[str, Any], weights: Weights, kept: Mapping[str, Memory]) -> Weights:
    """Where nothing is active: the suspended ones stay so, the others are not suspended by what is not known yet."""
    value = dict(weights.value)
    for task in spec["tasks"]:
        own = kept.get(task["name"])
        if own is not None and own.suspended:
            value[task["name"]] = Fraction(0)
        elif own is not None and not value[task["name"]]:
            value[task["name"]] = Fraction(str(task.get("priority", 1)))
    return Weights(value, weights.unable)


def _own_reads(spec: Mapping[str, Any], task: Mapping[str, Any]) -> frozenset[str]:
    parts = [*task.get("activity", ()), *(one for one in task.get("requires", ()) if "when" in one)]
    carried = {part["stream"] for part in parts if "stream" in part}
    changing = [one["name"] for one in spec.get("contexts", ()) if task["name"] in one.get("tasks", {})]
    sources = [source for part in parts for source in _sources(part)]
    return frozenset(carried) | _reads(spec, sources) | frozenset().union(*(_of_context(spec, c) for c in changing))


def _sources(part: Mapping[str, Any]) -> list[str]:
    return [part[name] for name in EXPRESSIONS if name in part]


def _reads(spec: Mapping[str, Any], sources: Iterable[str]) -> frozenset[str]:
    found: frozenset[str] = frozenset()
    for source in sources:
        found |= streams_in(source).union(*(_of_context(spec, name) for name in contexts_in(source)))
    return found


def _of_context(spec: Mapping[str, Any], name: str) -> frozenset[str]:
    """Its conditions' streams, and those whose silence it is the fallback of."""
    context = next(one for one in spec["contexts"] if one["name"] == name)
    silent = frozenset(
        stream["name"]
        for stream in spec["streams"]
        if ("staleAfter" in stream or "liveliness" in stream) and stream.get("fallback", spec.get("fallback")) == name
    )
    return silent | _reads(spec, _sources(context))


def _around(spec: Mapping[str, Any], name: str) -> set[str]:
    """The task, its parts, what it is a part of, what it requires, and so on from each of these."""
    tasks = {task["name"]: task for task in spec["tasks"]}
    found: set[str] = set()
    new = [name]
    while new:
        one = new.pop()
        found.add(one)
        required = [other["task"] for other in tasks[one].get("requires", ()) if "task" in other]
        parents = [other for other, task in tasks.items() if one in task.get("subtasks", ())]
        new += [other for other in (*required, *parents, *tasks[one].get("subtasks", ())) if other not in found]
    return found
