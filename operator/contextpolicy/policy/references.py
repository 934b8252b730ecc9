"""What only the whole policy can show: names are unique, references exist, the task graph has no cycles."""

from __future__ import annotations

from collections import Counter
from itertools import chain, pairwise
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_functions import OWN, RESERVED
from contextpolicy.policy.cel_kinds import CallCost
from contextpolicy.policy.context_reads import Dependencies
from contextpolicy.policy.dependencies import LEVELS, TaskTree
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.suggestions import did_you_mean
from contextpolicy.policy.written import expressions, reads_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from contextpolicy.policy.spec import Effect, Policy, Task

MOST_NAMES = 16
"""That a finding lists of those there are."""


def check(policy: Policy) -> Iterator[Finding]:
    """Every duplicate name, unresolved reference and cycle."""
    return chain(_names(policy), _streams(policy), _expressions(policy), _graph(policy), _contexts(policy))


def _names(policy: Policy) -> Iterator[Finding]:
    for kind, items in (("streams", policy.streams), ("tasks", policy.tasks), ("contexts", policy.contexts)):
        for name, count in Counter(item.name for item in items).items():
            if name and count > 1:
                yield Finding(f"spec.{kind}", name, f"unique names; this one appears {count} times")
    for index, stream in enumerate(policy.streams):
        if stream.name in RESERVED:
            yield Finding(f"spec.streams[{index}].name", stream.name, "a name that is not a reserved word of CEL")


def _streams(policy: Policy) -> Iterator[Finding]:
    names = [stream.name for stream in policy.streams]
    for index, stream in enumerate(policy.streams):
        if stream.produced_by is not None:
            yield from _known(f"spec.streams[{index}].producedBy", stream.produced_by, [t.name for t in policy.tasks])
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            if activity.stream is not None:
                yield from _known(f"spec.tasks[{index}].activity[{number}].stream", activity.stream, names)


def _expressions(policy: Policy) -> Iterator[Finding]:
    names = {stream.name for stream in policy.streams}
    contexts = [context.name for context in policy.contexts]
    for field, source, _ in expressions(policy):
        for unknown in sorted(Expression(source).variables - names):
            yield Finding(field, unknown, f"a stream of this policy: {_offer(unknown, names)}")
        yield from _read_contexts(field, source, contexts)
    for index, stream in enumerate(policy.streams):
        for field, own_source in (
            ("filter", stream.filter),
            *((f"features[{i}].of", f.of) for i, f in enumerate(stream.features)),
        ):
            if own_source is None:
                continue
            expression = Expression(own_source)
            for unknown in sorted(expression.variables - {stream.name}):
                yield Finding(f"spec.streams[{index}].{field}", unknown, f"only its own stream, {stream.name}")
            if expression.presence:
                asking = " and ".join(f"{one.name}()" for one in OWN if one.cost is CallCost.ASK)
                yield Finding(
                    f"spec.streams[{index}].{field}", own_source, f"a condition on the sample alone, without {asking}"
                )
            if expression.contexts:
                yield Finding(
                    f"spec.streams[{index}].{field}", own_source, "a condition on the sample alone, without contexts"
                )


def _read_contexts(field: str, source: str, names: Sequence[str]) -> Iterator[Finding]:
    for unknown in sorted(Expression(source).contexts - {*names}):
        cut = next((name for name in names if name.startswith(f"{unknown}-")), None)
        offer = (
            f"{_list(names)}; contexts.{cut} is a subtraction: write contexts['{cut}']"
            if cut
            else _offer(unknown, names)
        )
        yield Finding(field, unknown, f"a context of this policy: {offer}")


def _graph(policy: Policy) -> Iterator[Finding]:
    names = [task.name for task in policy.tasks]
    parents = Counter(name for task in policy.tasks for name in task.subtasks)
    tree = TaskTree(policy)
    for index, task in enumerate(policy.tasks):
        field = f"spec.tasks[{index}]"
        for number, name in enumerate(task.subtasks):
            yield from _known(f"{field}.subtasks[{number}]", name, names)
            if parents[name] > 1:
                yield Finding(f"{field}.subtasks[{number}]", name, "a subtask of one task only, named once")
        for number, requirement in enumerate(task.requires):
            if requirement.task is not None:
                yield from _known(f"{field}.requires[{number}].task", requirement.task, names)
        if len(tree.ancestors(task.name)) == LEVELS:
            yield Finding(field, task.name, f"a task graph of at most {LEVELS} levels")
    yield from _cycles(tree, names)


def _cycles(tree: TaskTree, names: list[str]) -> Iterator[Finding]:
    for cycle in tree.cycles():
        steps = [f"{one} waits for {other} ({tree.dependencies(one)[other]})" for one, other in pairwise(cycle)]
        allowed = f"no cycle in the task graph: {', '.join(steps)}"
        yield Finding(f"spec.tasks[{names.index(cycle[0])}]", " -> ".join(cycle), allowed)


def _contexts(policy: Policy) -> Iterator[Finding]:
    names = [context.name for context in policy.contexts]
    yield from _context_cycle(policy)
    if policy.fallback is not None:
        yield from _known("spec.fallback", policy.fallback, names)
    for index, stream in enumerate(policy.streams):
        if stream.fallback is not None:
            yield from _known(f"spec.streams[{index}].fallback", stream.fallback, names)
    if policy.force is not None:
        yield from _known("spec.force.context", policy.force.context, names)
    for index, context in enumerate(policy.contexts):
        for task in context.effects:
            yield from _known(f"spec.contexts[{index}].tasks", task, [t.name for t in policy.tasks])
    yield from _bounds(policy)


def _bounds(policy: Policy) -> Iterator[Finding]:
    """The bounds of contexts that are not within the task's own."""
    tasks = {task.name: task for task in policy.tasks}
    for index, context in enumerate(policy.contexts):
        for name, effect in context.effects.items():
            task = tasks.get(name)
            if task is None or not effect.bounds:
                continue
            field = f"spec.contexts[{index}].tasks.{name}"
            if task.subtasks:
                yield Finding(field, name, "no min and max here: a task with subtasks has no container")
            elif effect.suspends:
                yield Finding(field, name, "no min and max here: the context suspends the task (see suspendedCpu)")
            else:
                yield from _outside(field, task, effect)


def _outside(field: str, task: Task, effect: Effect) -> Iterator[Finding]:
    most = "" if task.max is None else f" and at most its max, {format_cpu(task.max)}"
    least = task.min
    for name, bound in (("min", effect.min), ("max", effect.max)):
        if bound is None:
            continue
        if bound < least or (task.max is not None and bound > task.max):
            what = "the context's min" if least == effect.min else "the task's min"
            yield Finding(f"{field}.{name}", format_cpu(bound), f"at least {what}, {format_cpu(least)}{most}")
        elif name == "max" and bound < task.suspended_cpu:
            yield Finding(f"{field}.max", format_cpu(bound), f"at least suspendedCpu, {format_cpu(task.suspended_cpu)}")
        least = max(least, bound)


def _context_cycle(policy: Policy) -> Iterator[Finding]:
    cycle = Dependencies(reads_of(policy.contexts)).cycle()
    if cycle is not None:
        steps = ", ".join(f"{one} reads {other}" for one, other in pairwise(cycle))
        place = [context.name for context in policy.contexts].index(cycle[0])
        yield Finding(f"spec.contexts[{place}]", " -> ".join(cycle), f"no cycle of contexts: {steps}")


def _known(field: str, name: str, names: Iterable[str]) -> Iterator[Finding]:
    if name not in names:
        yield Finding(field, name, _offer(name, names) if any(names) else "no name, as none are declared")


def _offer(name: str, names: Iterable[str]) -> str:
    """The names, and which of several may be meant."""
    several = len({*names} - {""}) > 1
    return _list(names) + (did_you_mean(name, names) if several else "")


def _list(names: Iterable[str]) -> str:
    # A name that was refused when it was read is empty by now; its own finding has it.
    usable = sorted({name for name in names if name})
    more = f" and {len(usable) - MOST_NAMES} more" if len(usable) > MOST_NAMES else ""
    listed = ", ".join(usable[:MOST_NAMES]) + more
    return f"one of {listed}" if len(usable) > 1 else listed or "none are declared"
