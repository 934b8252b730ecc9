"""Warnings about effects of a context that change nothing: on tasks that can't run or score, or are not suspended."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.standstill import Standstill

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.activities import Activity
    from contextpolicy.policy.spec import Context, Policy, Task
    from contextpolicy.policy.validation.situations import Situations


class InVain:
    """All of one policy."""

    def __init__(self, policy: Policy, situations: Situations) -> None:
        self._policy, self._situations, self._standstill = policy, situations, Standstill(policy)

    def of(self, field: str, context: Context, task: Task) -> Iterator[Finding]:
        """The findings about one context's effect on a task."""
        effect = context.effects[task.name]
        for what, value in (("weight", effect.weight), ("scale", effect.scale)):
            why = self._why(what, context, task) if value else None
            if why:
                yield Finding(f"{field}.{what}", value, f"{what} has no effect: {why}")
        if effect.suspend is False and not any(self._takes_back(context, one, task) for one in self._before(context)):
            why = f"no context before {context.name} suspends {task.name} beside it"
            yield Finding(f"{field}.suspend", effect.suspend, f"suspend: false has no effect: {why}")

    def _why(self, what: str, context: Context, task: Task) -> str | None:
        """Why a task gets nothing of a weight or scale while the context holds; None if it may."""
        causes = self._standstill.causes(context, task.name)
        if causes:
            return f"{task.name} can't run without {' and '.join(causes)}, which {context.name} suspends"
        at_rest = what == "scale" and self._rests(context, task)
        return f"{task.name} scores 0 while {context.name} holds" if at_rest else None

    def _rests(self, context: Context, task: Task) -> bool:
        """Whether a context excludes each activity of a task that scores by nothing else, and nothing weights it."""
        if task.idle or task.subtasks or not (task.priority and task.activity and context.when):
            return False
        if any(one.effects[task.name].weight for one in self._policy.contexts if task.name in one.effects):
            return False
        return all(self._excludes(context, own) for own in task.activity)

    def _excludes(self, context: Context, activity: Activity) -> bool:
        return not activity.outlasts and self._situations.never(f"contexts['{context.name}']", activity.when)

    def _before(self, context: Context) -> list[Context]:
        return list(self._policy.contexts[: self._policy.contexts.index(context)])

    def _takes_back(self, context: Context, earlier: Context, task: Task) -> bool:
        """Whether an earlier context suspends the task and may hold beside this one; one without `when` may always."""
        if task.name not in earlier.effects or not earlier.effects[task.name].suspends:
            return False
        both = f"contexts['{earlier.name}'] && contexts['{context.name}']"
        return not (earlier.when and context.when and self._situations.never(both))
