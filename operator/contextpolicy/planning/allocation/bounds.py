"""Each task's bounds while contexts hold: they narrow its own `min` and `max`, and the later in the list decides."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.allocation.seating import Seating, seat_tasks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.policy.spec import Context, Policy, Task


def within(task: Task, contexts: Sequence[Context]) -> Task:
    """The task with the bounds that these active contexts, in list order, leave it."""
    least, most = task.min, task.max
    for context in contexts:
        effect = context.effects.get(task.name)
        if effect is None:
            continue
        if effect.min is not None:
            least, most = effect.min, most if most is None else max(most, effect.min)
        if effect.max is not None:
            least, most = min(least, effect.max), effect.max
    return task if (least, most) == (task.min, task.max) else replace(task, min=least, max=most)


def policy_within(policy: Policy, contexts: Sequence[Context]) -> Policy:
    """The policy whose tasks have those bounds."""
    return replace(policy, tasks=tuple(within(task, contexts) for task in policy.tasks))


KNOWN = 64
"""Combinations of contexts whose seating is kept: a policy may have more of them than there is memory."""


class BoundedSeating:
    """The seating of the current placement within the bounds of the active contexts.

    A combination of contexts is seated once, as it may come and go with every sample.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._bounding = {
            context.name for context in policy.contexts if any(effect.bounds for effect in context.effects.values())
        }
        self._placement = Placement()
        self.varies = bool(self._bounding)
        """Whether contexts matter."""
        self.own = Seating()
        """The seating within the tasks' own bounds."""
        self._placed: dict[tuple[str, ...], Seating] = {}

    def place(self, placement: Placement) -> None:
        """Take where the containers run."""
        self._placement = placement
        self.own = seat_tasks(self._policy, placement)
        self._placed = {(): self.own}

    def seating(self, contexts: Sequence[Context]) -> Seating:
        """The seating while these contexts are active."""
        active = tuple([context.name for context in contexts if context.name in self._bounding])
        if active not in self._placed:
            if len(self._placed) == KNOWN:
                self._placed = {(): self.own}
            self._placed[active] = self._seat(contexts)
        return self._placed[active]

    def _seat(self, contexts: Sequence[Context]) -> Seating:
        own = policy_within(self._policy, contexts)
        changed = {
            task.name: task.max
            for task, before in zip(own.tasks, self._policy.tasks, strict=True)
            if task.max is not None and task.max != before.max
        }
        seated = seat_tasks(own, self._placement)
        nodes = tuple(
            replace(node, caps={seat.task: changed[seat.task] for seat in node.seats if seat.task in changed})
            for node in seated.nodes
        )
        return replace(seated, nodes=nodes)
