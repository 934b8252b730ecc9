"""Warnings: what is allowed but cannot be what its author wants. Each is certain, not a matter of taste."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.bandwidth import throttle_gap
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.dependencies import TaskTree
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy, Task


def advice(policy: Policy) -> Iterator[Finding]:
    """Every warning about a valid policy; a finding's `allowed` holds the reason."""
    yield from _streams(policy)
    for index, task in enumerate(policy.tasks):
        yield from _task(policy, f"spec.tasks[{index}]", task)
    yield from _contexts(policy)


def _streams(policy: Policy) -> Iterator[Finding]:
    sources = list(_sources(policy))
    read = {name for source in sources for name in Expression(source).variables}
    read |= {activity.stream for task in policy.tasks for activity in task.activity if activity.stream}
    # Nobody can tell what a plug-in reads: with one, no stream or feature is reported as unread.
    plugged_in = any(activity.initiative for task in policy.tasks for activity in task.activity)
    for index, stream in enumerate(policy.streams):
        # A stream may matter by its silence alone, which puts the fallback in force.
        watched = policy.fallback is not None and (stream.stale_after or stream.liveliness)
        if stream.name not in read and not plugged_in and not watched:
            yield Finding(f"spec.streams[{index}]", stream.name, f"nothing reads stream {stream.name}")
        if stream.types and stream.definitions is None:
            told = f"ConfigMap {stream.types} is in none of the files, its messages are unchecked (--types DIR)"
            yield Finding(f"spec.streams[{index}].types", stream.types, told)
        for number, feature in enumerate(stream.features):
            pattern = re.compile(rf"\b{stream.name}\.{feature.name}\b")
            if not plugged_in and not any(pattern.search(source) for source in sources):
                field = f"spec.streams[{index}].features[{number}]"
                yield Finding(
                    field, feature.name, f"nothing reads {stream.name}.{feature.name}; it costs with every sample"
                )


def _sources(policy: Policy) -> Iterator[str]:
    for task in policy.tasks:
        yield from (requirement.when for requirement in task.preconditions)
        for activity in task.activity:
            yield from filter(None, (activity.when, activity.score_from))
    yield from (context.when for context in policy.contexts if context.when)


def _task(policy: Policy, field: str, task: Task) -> Iterator[Finding]:
    if task.priority == 0 and not any(context.effects.get(task.name) for context in policy.contexts):
        yield Finding(f"{field}.priority", 0, "a task of priority 0 that no context changes is always suspended")
    for number, activity in enumerate(task.activity):
        if activity.score == 0 and not activity.score_from and not activity.initiative:
            yield Finding(f"{field}.activity[{number}].score", 0, "an activity with score 0 never counts")
    if task.restart_on_resize and not policy.enforcement.min_dwell:
        told = "every plan that changes its share may restart it: minDwell bounds how often"
        yield Finding(f"{field}.restartOnResize", task.restart_on_resize, told)
    if task.protected:
        yield from _suspending(policy, task)
    if task.max is None:
        return
    if task.needs.cores is not None and task.needs.cores > task.max:
        told = f"needs {format_cpu(task.needs.cores)} cores, but max allows {format_cpu(task.max)}: never feasible"
        yield Finding(f"{field}.needs.cores", task.needs.cores, told)
    gap = throttle_gap(task.max, policy.enforcement.period) if policy.enforcement.scheduler is Scheduler.CFS else 0.0
    if task.needs.deadline is not None and gap > task.needs.deadline:
        told = f"with max {format_cpu(task.max)} it may stand still for {gap:.3g} s, longer than its deadline"
        yield Finding(f"{field}.needs.deadline", task.needs.deadline, told)


def _suspending(policy: Policy, task: Task) -> Iterator[Finding]:
    """Contexts that try to suspend a protected task, directly or through a task that it is a part of."""
    above = TaskTree(policy).ancestors(task.name)
    for index, context in enumerate(policy.contexts):
        for name in (task.name, *above):
            effect = context.effects.get(name)
            if effect is not None and effect.suspends:
                part = "" if name == task.name else f", of which {task.name} is a part"
                told = (
                    f"context {context.name} suspends {name}{part}: it has no effect on {task.name}, which is protected"
                )
                yield Finding(f"spec.contexts[{index}].tasks.{name}", task.name, told)


def _contexts(policy: Policy) -> Iterator[Finding]:
    if policy.fallback and not any(stream.stale_after or stream.liveliness for stream in policy.streams):
        yield Finding("spec.fallback", policy.fallback, "never holds: no stream has staleAfter or liveliness")
    for index, context in enumerate(policy.contexts):
        field = f"spec.contexts[{index}]"
        forced = policy.force is not None and policy.force.context == context.name
        if (context.when or "false").strip() == "false" and not forced and policy.fallback != context.name:
            told = "can't hold: it has no condition, and is neither the fallback nor forced"
            yield Finding(field, context.name, f"context {context.name} {told}")
        if not context.effects:
            yield Finding(field, context.name, f"context {context.name} changes no task")
        if context.when and not (context.enter_after or context.exit_after or policy.enforcement.min_dwell):
            told = "may change with every sample: enterAfter, exitAfter or minDwell bound how often pods are resized"
            yield Finding(field, context.name, f"context {context.name} {told}")
