"""What the active contexts together do to one task: they apply in list order."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.policy.spec import Context, Task


class Influence(NamedTuple):
    """`suspended_by` is the context that suspends the task now; `weighting` are those that make its weight, in order.

    The first of `weighting` may replace the weight; each of the others multiplies what the one before left.
    """

    suspended_by: Context | None
    weighting: tuple[Context, ...]


def influence(task: Task, contexts: Sequence[Context]) -> Influence:
    """`weight` replaces, `scale` multiplies, and a suspension lasts until a later context says `suspend: false`.

    No context suspends a protected task.
    """
    suspended_by: Context | None = None
    weighting: tuple[Context, ...] = ()
    for context in contexts:
        effect = context.effects.get(task.name)
        if effect is None:
            continue
        if effect.suspends:
            suspended_by = None if task.protected else context
            continue
        if effect.suspend is False:
            suspended_by = None
        if effect.weight is not None:
            weighting = (context,)
        elif effect.scale is not None:
            weighting = (*weighting, context)
    return Influence(suspended_by, weighting)
