"""Warnings about tasks of priority 0: only a context's `weight` gives them CPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy, Task


def priorities(policy: Policy) -> Iterator[Finding]:
    """What can't count beside priority 0, and the tasks that it leaves without CPU for good."""
    for index, task in enumerate(policy.tasks):
        if task.priority == 0:
            yield from _task(policy, f"spec.tasks[{index}]", task)
            yield from _scales(policy, task)


def _task(policy: Policy, field: str, task: Task) -> Iterator[Finding]:
    if not any(context.effects[task.name].weight for context in policy.contexts if task.name in context.effects):
        becomes = "never gets more than its min" if task.protected else "is always suspended"
        yield Finding(f"{field}.priority", 0, f"a task of priority 0 whose weight no context sets {becomes}")
    for name, value in (("activity", len(task.activity)), ("idle", task.idle)):
        if value:
            yield Finding(f"{field}.{name}", value, f"{name} has no effect: priority 0 makes each of its scores 0")


def _scales(policy: Policy, task: Task) -> Iterator[Finding]:
    for index, context in enumerate(policy.contexts):
        effect = context.effects.get(task.name)
        if effect and effect.weight:
            return
        if effect and effect.scale:
            message = f"scale has no effect: {task.name} has priority 0, and no context before sets its weight"
            yield Finding(f"spec.contexts[{index}].tasks.{task.name}.scale", effect.scale, message)
