"""The strongest static divisions that were measured, and what the others lose against them. Pure."""

from __future__ import annotations

from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

from tests.bench.enforcement.divisions import STATIC, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import Cell
from tests.bench.enforcement.stories import SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.bench.enforcement.figures import Figures

    Find = Callable[[Cell], Figures | None]


class Opponent(NamedTuple):
    """A static division and what was measured of it."""

    division: str
    figures: Figures


def best_static(find: Find, story: str, load: float, *, gated: bool) -> Opponent | None:
    """The static division whose worst context hits most, then the mean of the contexts; None if none was measured.

    The tuned weights are one among them: a search that finds nothing better than what a user writes at once is no
    opponent.
    """
    found = {name: find(Cell(story, load, Queue.NEWEST, gated, name)) for name in STATIC}
    measured = [Opponent(name, figures) for name, figures in found.items() if figures]
    return max(measured, key=_served, default=None)


def losses_of_others(find: Find, load: float) -> dict[str, float]:
    """With equal gating, by task: what those lose that are neither critical nor protected, against the best static one.

    Over the contexts in which they are not critical, in parts of 1; below 0 they gain.
    """
    ours = find(Cell(SUSPENDING.name, load, Queue.NEWEST, gated=True, division=WEIGHTS))
    best = best_static(find, SUSPENDING.name, load, gated=True)
    if not ours or not best:
        return {}
    beside = {
        name: [context.name for context in ours.story.contexts if name not in {context.critical, *context.suspends}]
        for name, task in ours.tasks.items()
        if not task.protected
    }
    return {name: best.figures.hit(name, where) - ours.hit(name, where) for name, where in beside.items() if where}


def _served(opponent: Opponent) -> tuple[float, float]:
    rates = opponent.figures.critical().values()
    return min(rates), fmean(rates)
