"""What only the whole policy can tell: names are unique, references exist, the task graph is a forest of depth two."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.policy.spec import Policy, Task

CEL_WORDS = {
    *("true", "false", "null", "in", "as", "break", "const", "continue", "else", "for", "function", "if", "import"),
    *("let", "loop", "package", "namespace", "return", "var", "void", "while"),
    *("min", "max", "abs", "norm", "sqrt", "size", "has", "heard", "age"),
}


def check(policy: Policy) -> list[Finding]:
    """Every reference that leads nowhere."""
    return [*_names(policy), *_streams(policy), *_expressions(policy), *_graph(policy), *_contexts(policy)]


def _names(policy: Policy) -> Iterator[Finding]:
    for kind, items in (("streams", policy.streams), ("tasks", policy.tasks), ("contexts", policy.contexts)):
        for name, count in Counter(item.name for item in items).items():
            if count > 1:
                yield Finding(f"spec.{kind}", name, f"each name once, this one stands {count} times")
    for index, stream in enumerate(policy.streams):
        if stream.name in CEL_WORDS:
            yield Finding(f"spec.streams[{index}].name", stream.name, "a name that is no word of CEL")


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
    for field, source in _sources(policy):
        for unknown in sorted(Expression(source).variables - names):
            yield Finding(field, unknown, f"a stream of this policy: {_list(names)}{did_you_mean(unknown, names)}")
    for index, stream in enumerate(policy.streams):
        for field, own_source in (
            ("filter", stream.filter),
            *((f"features[{i}].of", f.of) for i, f in enumerate(stream.features)),
        ):
            if own_source is None:
                continue
            expression = Expression(own_source)
            for unknown in sorted(expression.variables - {stream.name}):
                yield Finding(f"spec.streams[{index}].{field}", unknown, f"its own stream only: {stream.name}")
            if expression.presence:
                yield Finding(
                    f"spec.streams[{index}].{field}", own_source, "what a sample says, without heard() and age()"
                )


def _sources(policy: Policy) -> Iterator[tuple[str, str]]:
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            yield f"spec.tasks[{index}].activity[{number}].when", activity.when
            if activity.score_from is not None:
                yield f"spec.tasks[{index}].activity[{number}].scoreFrom", activity.score_from
        for number, requirement in enumerate(task.requires):
            yield f"spec.tasks[{index}].requires[{number}].when", requirement.when
    for index, context in enumerate(policy.contexts):
        if context.when is not None:
            yield f"spec.contexts[{index}].when", context.when


def _graph(policy: Policy) -> Iterator[Finding]:
    tasks = {task.name: task for task in policy.tasks}
    parents = Counter(name for task in policy.tasks for name in task.subtasks)
    for index, task in enumerate(policy.tasks):
        for number, name in enumerate(task.subtasks):
            yield from _subtask(f"spec.tasks[{index}].subtasks[{number}]", name, tasks, parents)


def _subtask(field: str, name: str, tasks: dict[str, Task], parents: Counter[str]) -> Iterator[Finding]:
    yield from _known(field, name, tasks)
    if parents[name] > 1:
        yield Finding(field, name, "a subtask of one task only, named once")
    if name in tasks and tasks[name].subtasks:
        yield Finding(field, name, "a task without subtasks of its own")


def _contexts(policy: Policy) -> Iterator[Finding]:
    names = [context.name for context in policy.contexts]
    if policy.fallback is not None:
        yield from _known("spec.fallback", policy.fallback, names)
    if policy.force is not None:
        yield from _known("spec.force.context", policy.force.context, names)
    for index, context in enumerate(policy.contexts):
        for task in context.effects:
            yield from _known(f"spec.contexts[{index}].tasks", task, [t.name for t in policy.tasks])


def _known(field: str, name: str, names: Iterable[str]) -> Iterator[Finding]:
    if name not in names:
        yield Finding(field, name, _list(names) + did_you_mean(name, names))


def _list(names: Iterable[str]) -> str:
    return "one of " + ", ".join(sorted(names)) if names else "none are declared"
