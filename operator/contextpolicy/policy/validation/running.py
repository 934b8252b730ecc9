"""Tasks that surely have weight: where none has, even those at rest share the node."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.spec import SatisfiedBy

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from contextpolicy.policy.dependencies import TaskTree
    from contextpolicy.policy.spec import Context, Task


class Running:
    """While the contexts that `hold` do, and such `others` as `may`."""

    def __init__(
        self, tree: TaskTree, hold: Sequence[Context], others: Sequence[Context], may: Callable[[Context], bool]
    ) -> None:
        self._tree, self._hold, self._others, self._may = tree, hold, others, may

    def any(self) -> bool:
        """Whether a task has weight at each moment."""
        return any(not task.subtasks and self._runs(task) for task in self._tree.tasks.values())

    def _runs(self, task: Task) -> bool:
        above = [self._tree.tasks[name] for name in self._tree.ancestors(task.name)]
        return all(self._weighs(one) for one in (task, *above)) and self._can(task) and all(map(self._can, above))

    def _weighs(self, task: Task) -> bool:
        """Whether it has weight if it can run: a context that holds gives it some, or it scores without an event."""
        effects = [context.effects[task.name] for context in self._hold if task.name in context.effects]
        scores = bool(task.idle) or (task.idle is None and not task.activity)
        return any(effect.weight for effect in effects) or (scores and task.priority > 0)

    def _can(self, task: Task) -> bool:
        """Whether nothing keeps it from running: what it requires, what it needs, a context or its parts."""
        if task.requires or task.needs.enforce is Enforce.SUSPEND or (not task.protected and self._is_stopped(task)):
            return False
        parts = [self._can(self._tree.tasks[name]) for name in task.subtasks]
        return not parts or (all if task.satisfied_by is SatisfiedBy.ALL else any)(parts)

    def _is_stopped(self, task: Task) -> bool:
        stopping = [
            [one for one in contexts if task.name in one.effects and one.effects[task.name].suspends]
            for contexts in (self._hold, self._others)
        ]
        return bool(stopping[0]) or any(map(self._may, stopping[1]))
