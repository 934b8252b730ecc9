"""Scores -> weights: priorities, pre-conditions, active contexts and the task graph (paper III, IV-B)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.planning.allocation.influence import Influence, influence
from contextpolicy.policy.dependencies import TaskTree
from contextpolicy.policy.spec import SatisfiedBy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.policy.spec import Context, Policy, Task


HEAVIEST = 1e100
"""Weights stop here, so that sums and products of any finite priority, score and scale stay finite."""


class Weight(NamedTuple):
    """What a task's score became, and the last thing that changed it, for people to read.

    A task that is not `able` can't run now, whatever its score: a pre-condition, a context, its pod or its place in the
    task graph keeps it from running. One that is able and weighs 0 is at rest.
    """

    score: float
    value: float
    because: str
    able: bool = True


class Obstacles(NamedTuple):
    """What keeps tasks from running, by task, besides contexts: an unmet pre-condition, no running pod, unmet needs."""

    waiting: Mapping[str, str]
    absent: AbstractSet[str] = frozenset()
    yielding: Mapping[str, str] = {}


class Weigher:
    """Weighs the tasks of one policy; a task whose inputs are unchanged keeps its last weight."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._tree = policy, TaskTree(policy)
        self._order = self._tree.order()
        self._required = {task.name: task.required_tasks for task in policy.tasks}
        groups = [task for task in policy.tasks if task.subtasks]
        self._groups = sorted(groups, key=lambda task: len(self._tree.ancestors(task.name)))
        self._contexts: Sequence[Context] = ()
        self._influences = self._find_influences()
        self._own: dict[str, Weight] = {}
        self._scores: Mapping[str, float] = {}
        """What `_own` was made from; empty when other contexts hold, which rebuilds all of it."""
        self._seen: tuple[object, ...] | None = None
        self._blocked: dict[str, str] = {}
        self._alone: dict[str, str] = {}
        """Protected tasks that go on although what they are a part of can't run, with their parent."""

    def weigh(
        self, scores: Mapping[str, float], obstacles: Obstacles, contexts: Sequence[Context]
    ) -> dict[str, Weight]:
        """The weight of every task.

        `scores` has every task; `contexts` are the active ones in list order.
        """
        self._look_at(obstacles, contexts)
        own, tasks = self._own, self._tree.tasks
        for name in [name for name, score in scores.items() if self._scores.get(name) != score]:
            own[name] = _own_weight(tasks[name], scores[name], self._influences[name])
        self._scores = dict(scores)
        return self._spread(dict(own))

    def weigh_at_rest(self) -> dict[str, Weight]:
        """What the tasks would weigh if all scored 1, with the last obstacles: in effect, their priorities."""
        of = self._influences
        return self._spread({task.name: _own_weight(task, 1.0, of[task.name]) for task in self._policy.tasks})

    def _look_at(self, obstacles: Obstacles, contexts: Sequence[Context]) -> None:
        """Recompute who can run only if that may have changed: it does so rarely, scores with every sample."""
        if contexts != self._contexts:
            self._contexts = contexts
            self._influences = self._find_influences()
            self._scores = {}
        seen = (contexts, dict(obstacles.waiting), obstacles.absent, obstacles.yielding)
        if seen != self._seen:
            self._seen = seen
            self._blocked = self._find_blocked(obstacles)
            self._alone = self._find_alone()

    def _find_influences(self) -> dict[str, Influence]:
        return {task.name: influence(task, self._contexts) for task in self._policy.tasks}

    def _find_blocked(self, obstacles: Obstacles) -> dict[str, str]:
        """Each task that can't run, with the reason; dependencies come before their dependents."""
        blocked: dict[str, str] = {}
        for name in self._order:
            task = self._tree.tasks[name]
            reason = _obstacle(task, obstacles, self._influences[name]) or self._missing_task(task, blocked)
            if reason is None and task.subtasks:
                reason = _missing_part(task, blocked)
            if reason is not None:
                blocked[name] = reason
        return blocked

    def _find_alone(self) -> dict[str, str]:
        return {
            name: self._tree.ancestors(name)[0]
            for name, task in self._tree.tasks.items()
            if task.protected
            and name not in self._blocked
            and any(above in self._blocked for above in self._tree.ancestors(name))
        }

    def _missing_task(self, task: Task, blocked: Mapping[str, str]) -> str | None:
        for required in self._required[task.name]:
            above = () if self._tree.tasks[required].protected else self._tree.outside(task.name, required)
            for one in (required, *above):
                if one in blocked:
                    return f"waits for task {required}; {one}: {blocked[one]}"
        return None

    def _spread(self, own: dict[str, Weight]) -> dict[str, Weight]:
        """Zero the tasks that can't run, and split each parent's weight over its subtasks.

        A protected task that goes on alone keeps the part that it has when all can run, so that to suspend what it is a
        part of never makes it heavier.
        """
        kept = self._split_all(dict(own)) if self._alone else {}
        for name, reason in self._blocked.items():
            own[name] = Weight(own[name].score, 0.0, reason, able=False)
        own = self._split_all(own)
        for name, parent in self._alone.items():
            because = f"protected, so it continues without {parent}; {kept[name].because}"
            own[name] = kept[name]._replace(because=because)
        return own

    def _split_all(self, own: dict[str, Weight]) -> dict[str, Weight]:
        # Innermost first: a parent without an active subtask is idle, which may leave its own parent idle.
        for parent in reversed(self._groups):
            if own[parent.name].value > 0 and not any(own[name].value for name in parent.subtasks):
                own[parent.name] = own[parent.name]._replace(value=0.0, because=_idle_reason(parent, own))
        # Outermost first: a parent's own weight is final before it is split.
        for parent in self._groups:
            own |= _split(parent, own)
        return own


def _obstacle(task: Task, obstacles: Obstacles, contexts: Influence) -> str | None:
    """What keeps this one task from running, whatever becomes of the others."""
    if task.name in obstacles.waiting:
        return f"waits for {obstacles.waiting[task.name]}"
    if contexts.suspended_by is not None:
        return f"context {contexts.suspended_by.name} suspends it"
    if task.name in obstacles.yielding:
        return f"yields to the others: it {obstacles.yielding[task.name]}"
    return "has no running pod" if task.name in obstacles.absent else None


def _missing_part(task: Task, blocked: Mapping[str, str]) -> str | None:
    """Why a task can't run for want of its subtasks (paper III: compound and complex tasks)."""
    missing = [name for name in task.subtasks if name in blocked]
    if missing and task.satisfied_by is SatisfiedBy.ALL:
        return f"needs all its subtasks; {missing[0]}: {blocked[missing[0]]}"
    if len(missing) == len(task.subtasks):
        return f"no subtask can run; {missing[0]}: {blocked[missing[0]]}"
    return None


def _own_weight(task: Task, score: float, contexts: Influence) -> Weight:
    """What a task that can run weighs, before its parent's weight is split."""
    value = min(task.priority * score, HEAVIEST)
    if not contexts.weighting:
        return Weight(score, value, f"priority {task.priority:g} times score {score:g}")
    reasons = []
    for context in contexts.weighting:
        effect = context.effects[task.name]
        if effect.weight is not None:
            value = effect.weight
            reasons.append(f"context {context.name} sets its weight to {effect.weight:g}")
        elif effect.scale is not None:
            value = min(value * effect.scale, HEAVIEST)
            reasons.append(f"context {context.name} scales its weight by {effect.scale:g}")
    return Weight(score, value, ", ".join(reasons))


def _split(parent: Task, own: Mapping[str, Weight]) -> dict[str, Weight]:
    """The subtasks' weights: the parent's, split over those that can run in proportion to their own weights."""
    above = own[parent.name]
    active = sum(own[name].value for name in parent.subtasks)
    if above.value == 0 or active == 0:
        return {name: _without(parent, above, own[name]) for name in parent.subtasks}
    return {name: _part(parent, above, own[name], active) for name in parent.subtasks}


def _part(parent: Task, above: Weight, own: Weight, active: float) -> Weight:
    if not own.able:
        return own
    because = f"part of {parent.name}'s {above.value:g}; {own.because}"
    return own._replace(value=above.value * own.value / active, because=because)


def _without(parent: Task, above: Weight, own: Weight) -> Weight:
    """A subtask whose parent has no weight."""
    if not own.able:
        return own
    because = own.because if above.able and own.value == 0 else f"{parent.name}: {above.because}"
    return Weight(own.score, 0.0, because, above.able)


def _idle_reason(parent: Task, own: Mapping[str, Weight]) -> str:
    first = parent.subtasks[0]
    return f"no subtask is active; {first}: {own[first].because}"
