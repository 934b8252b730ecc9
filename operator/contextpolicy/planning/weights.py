"""Scores -> weights: priorities, pre-conditions, active contexts and the task graph (paper III, IV-B)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.spec import SatisfiedBy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.policy.spec import Context, Policy, Task


HEAVIEST = 1e100
"""Weights stop here, so that sums and products of any finite priority, score and scale stay finite."""


class Weight(NamedTuple):
    """What a task's score became, and the last thing that changed it, for people to read."""

    score: float
    value: float
    because: str


class Weigher:
    """Weighs the tasks of one policy, and what did not change since the last time not again."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._contexts: Sequence[Context] = ()
        self._known: dict[str, tuple[float, str | None, Weight]] = {}

    def weigh(
        self, scores: Mapping[str, float], waiting: Mapping[str, str], contexts: Sequence[Context]
    ) -> dict[str, Weight]:
        """The weight of every task.

        `scores` has every task; `waiting` names the unmet pre-condition of each task that has one; `contexts` are the
        active ones in list order: the last one that names a task decides.
        """
        if contexts != self._contexts:
            self._contexts = contexts
            self._known.clear()
        own = {t.name: self._own(t, scores[t.name], waiting.get(t.name)) for t in self._policy.tasks}
        for parent in self._policy.tasks:
            if parent.subtasks:
                own |= _split(parent, own, contexts)
        return own

    def _own(self, task: Task, score: float, unmet: str | None) -> Weight:
        known = self._known.get(task.name)
        if known is not None and known[0] == score and known[1] == unmet:
            return known[2]
        weight = _own_weight(task, score, unmet, self._contexts)
        self._known[task.name] = score, unmet, weight
        return weight


def _own_weight(task: Task, score: float, unmet: str | None, contexts: Sequence[Context]) -> Weight:
    base = min(task.priority * score, HEAVIEST)
    if unmet is not None:
        return Weight(score, 0.0, f"waits for {unmet}")
    for context in reversed(contexts):
        effect = context.effects.get(task.name)
        if effect is None:
            continue
        if effect.suspend:
            return Weight(score, 0.0, f"context {context.name} suspends it")
        if effect.weight is not None:
            return Weight(
                score, min(effect.weight, HEAVIEST), f"context {context.name} sets its weight to {effect.weight:g}"
            )
        scale = effect.scale if effect.scale is not None else 1.0
        return Weight(score, min(base * scale, HEAVIEST), f"context {context.name} scales its weight by {scale:g}")
    return Weight(score, base, f"priority {task.priority:g} times score {score:g}")


def _split(parent: Task, own: Mapping[str, Weight], contexts: Sequence[Context]) -> dict[str, Weight]:
    """The subtasks' weights: the parent's, split over the runnable ones in proportion to their own weights."""
    total = own[parent.name].value
    blocked = [name for name in parent.subtasks if _suspended(name, contexts)]
    if blocked and parent.satisfied_by is SatisfiedBy.ALL:
        reason = f"{parent.name} needs all its subtasks and {blocked[0]} is suspended"
        return {name: Weight(own[name].score, 0.0, reason) for name in (parent.name, *parent.subtasks)}
    runnable = sum(own[name].value for name in parent.subtasks)
    if total == 0 or runnable == 0:
        return {n: Weight(own[n].score, 0.0, _idle_reason(parent, own, n)) for n in (parent.name, *parent.subtasks)}
    return {
        name: Weight(
            own[name].score,
            total * own[name].value / runnable,
            f"part of {parent.name}'s {total:g}; {own[name].because}",
        )
        for name in parent.subtasks
    }


def _suspended(name: str, contexts: Sequence[Context]) -> bool:
    effects = [context.effects[name] for context in contexts if name in context.effects]
    return bool(effects) and (effects[-1].suspend or effects[-1].weight == 0)


def _idle_reason(parent: Task, own: Mapping[str, Weight], name: str) -> str:
    if own[parent.name].value == 0:
        return own[parent.name].because if name == parent.name else f"{parent.name}: {own[parent.name].because}"
    if name != parent.name:
        return own[name].because
    first = parent.subtasks[0]
    return f"no subtask can run; {first}: {own[first].because}"
