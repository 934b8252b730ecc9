"""Scores, contexts and the task graph become weights: the reference model's reading."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    Task = Mapping[str, Any]


class Weights(NamedTuple):
    """Each task's weight, and the tasks that can't run."""

    value: Mapping[str, Fraction]
    unable: frozenset[str]


def weigh(
    spec: Mapping[str, Any],
    scores: Mapping[str, Fraction],
    unmet: AbstractSet[str],
    contexts: Sequence[Mapping[str, Any]],
) -> Weights:
    """`unmet` are the tasks with a pre-condition that does not hold, `contexts` the active ones in list order."""
    scale = _Scale(spec, scores, unmet, contexts)
    weights = {name: scale.weight(name) for name in scale.tasks}
    return Weights(weights, frozenset(name for name in scale.tasks if not scale.runs(name)))


class _Scale:
    def __init__(
        self,
        spec: Mapping[str, Any],
        scores: Mapping[str, Fraction],
        unmet: AbstractSet[str],
        contexts: Sequence[Mapping[str, Any]],
    ) -> None:
        self.tasks: dict[str, Task] = {task["name"]: task for task in spec["tasks"]}
        self._parents = {name: task["name"] for task in spec["tasks"] for name in task.get("subtasks", ())}
        self._unmet = unmet
        self._own, self._suspended = {}, set()
        for name, task in self.tasks.items():
            self._own[name], suspended = _under_contexts(task, scores[name], contexts)
            self._suspended |= {name} if suspended else set()
        self._ideal = False

    def weight(self, name: str) -> Fraction:
        if self.runs(name) and not self._blocked(name) and any(self._blocked(one) for one in self._above(name)):
            return self._as_if_all_could_run(name)
        return self._part(name)

    def runs(self, name: str) -> bool:
        """Whether it can run, whatever its score: no part of it, and nothing that it is a part of, prevents it."""
        task = self.tasks[name]
        return not self._blocked(name) and (
            bool(task.get("protected")) or not any(self._blocked(one) for one in self._above(name))
        )

    def _blocked(self, name: str) -> bool:
        """By itself: by a pre-condition, a context, a task that it requires, or its subtasks."""
        task = self.tasks[name]
        if name in self._unmet or name in self._suspended:
            return True
        if any(not self._is_there(one["task"], name) for one in task.get("requires", ()) if "task" in one):
            return True
        missing = [one for one in task.get("subtasks", ()) if self._blocked(one)]
        return bool(missing) and (task.get("satisfiedBy", "All") == "All" or len(missing) == len(task["subtasks"]))

    def _is_there(self, required: str, by: str) -> bool:
        """Whether a required task can run; what both are a part of says nothing about the one without the other."""
        shared = {by, *self._above(by)}
        return not self._blocked(required) and (
            bool(self.tasks[required].get("protected"))
            or not any(self._blocked(one) for one in self._above(required) if one not in shared)
        )

    def _above(self, name: str) -> list[str]:
        parent = self._parents.get(name)
        return [] if parent is None else [parent, *self._above(parent)]

    def _as_if_all_could_run(self, name: str) -> Fraction:
        """A protected task goes on without the others with the part that it would have among them."""
        self._ideal = True
        part = self._part(name)
        self._ideal = False
        return part

    def _part(self, name: str) -> Fraction:
        parent = self._parents.get(name)
        if parent is None:
            return self._alone(name)
        siblings = sum((self._alone(one) for one in self.tasks[parent]["subtasks"]), Fraction(0))
        return self._part(parent) * self._alone(name) / siblings if siblings else Fraction(0)

    def _alone(self, name: str) -> Fraction:
        """Its own weight, before that of what it is a part of is split."""
        if self._blocked(name) and not self._ideal:
            return Fraction(0)
        subtasks = self.tasks[name].get("subtasks", ())
        return Fraction(0) if subtasks and not any(map(self._alone, subtasks)) else self._own[name]


def _under_contexts(task: Task, score: Fraction, contexts: Sequence[Mapping[str, Any]]) -> tuple[Fraction, bool]:
    """The weight that the contexts leave, and whether they suspend the task; they apply in list order."""
    weight, suspended = Fraction(str(task.get("priority", 1))) * score, False
    for context in contexts:
        effect = context.get("tasks", {}).get(task["name"], {})
        factor, replacement = effect.get("scale"), effect.get("weight")
        if effect.get("suspend") or factor == 0 or replacement == 0:
            suspended = not task.get("protected")
            continue
        if effect.get("suspend") is False:
            suspended = False
        if replacement is not None:
            weight = Fraction(str(replacement))
        if factor is not None:
            weight *= Fraction(str(factor))
    return weight, suspended
