"""The goals, and whether the figures meet them. Pure.

Only cells of the same gating are compared, except that the first law measures against plain Linux. A goal whose cells
are not all there is not judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.bench.enforcement.divisions import ALONE, DEFAULT, STATIC, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.matrix import HEAVY, LIGHT, Cell
from tests.bench.enforcement.opponents import best_static
from tests.bench.enforcement.policy import ATTEMPTS
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.bench.enforcement.opponents import Find

POINT = 0.01
SLOWER, LATER = 1.2, 0.005
"""How much a p99 may grow under light load: by a factor, and seconds more."""
KEPT = 0.97
"""Of what the critical task hits alone, and of the work that Linux default gets done."""
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Verdict:
    """One goal for one division: every figure that was compared, and the failures among them."""

    goal: str
    division: str
    compared: tuple[str, ...]
    failed: tuple[str, ...]

    @property
    def met(self) -> bool | None:
        """None if there was nothing to compare."""
        return not self.failed if self.compared else None


class _Comparison:
    """Collects what was compared."""

    def __init__(self) -> None:
        self._all: list[str] = []
        self._failed: list[str] = []

    def check(self, what: str, *, holds: bool) -> None:
        self._all.append(what)
        if not holds:  # a figure that is not a number fails too
            self._failed.append(what)

    def verdict(self, goal: str, division: str) -> Verdict:
        return Verdict(goal, division, tuple(self._all), tuple(self._failed))


def verdicts(find: Find) -> list[Verdict]:
    """All goals for context weights, and for the attempts if they were measured."""
    found = [
        verdict
        for division in (WEIGHTS, *ATTEMPTS)
        for verdict in (
            first_law(find, IMPORTANCE.name, division, gated=False),
            first_law(find, SUSPENDING.name, division, gated=True),
            *(heavy(find, load, division) for load in HEAVY),
            *(no_worse_than_static(find, load, division) for load in HEAVY),
        )
    ]
    return [verdict for verdict in found if verdict.division == WEIGHTS or verdict.compared]


def first_law(find: Find, story: str, division: str, *, gated: bool) -> Verdict:
    """Light load: nobody that runs loses more than a point or gets much slower, compared with plain Linux."""
    plain = find(Cell(story, LIGHT, Queue.NEWEST, gated=False, division=DEFAULT))
    ours = find(Cell(story, LIGHT, Queue.NEWEST, gated, division))
    comparison = _Comparison()
    for task in plain.tasks if plain and ours else ():
        assert plain
        assert ours
        before, now = plain.hit(task), ours.hit(task)
        comparison.check(
            f"{task} hits {now:.1%}, {before:.1%} under Linux default", holds=now >= before - POINT - ROUNDING
        )
        before, now = plain.quantile(task, 0.99), ours.quantile(task, 0.99)
        text = f"{task} p99 {now * 1000:.1f} ms, {before * 1000:.1f} ms under Linux default"
        comparison.check(text, holds=now <= before * SLOWER + LATER + ROUNDING)
    return comparison.verdict(f"first law: {story}, load {LIGHT:g}, {_gating(gated)}", division)


def heavy(find: Find, load: float, division: str) -> Verdict:
    """Heavy load, nothing suspended: each context's critical task keeps its hits, and the work is still done."""
    cell, alone, plain = (
        find(Cell(IMPORTANCE.name, load, Queue.NEWEST, gated=False, division=name))
        for name in (division, ALONE, DEFAULT)
    )
    comparison = _Comparison()
    if cell and alone and plain:
        undisturbed = alone.critical()
        for context, hit in cell.critical().items():
            text = f"{context}: {hit:.1%} of inputs hit, {undisturbed[context]:.1%} alone"
            comparison.check(text, holds=hit >= KEPT * undisturbed[context] - ROUNDING)
        text = f"work {cell.work:.2f} CPU s, {plain.work:.2f} under Linux default"
        comparison.check(text, holds=cell.work >= KEPT * plain.work - ROUNDING)
    return comparison.verdict(f"heavy: {IMPORTANCE.name}, load {load:g}, nothing suspended", division)


def no_worse_than_static(find: Find, load: float, division: str) -> Verdict:
    """With equal gating: critical and protected tasks lose at most a point against the best static division."""
    ours = find(Cell(SUSPENDING.name, load, Queue.NEWEST, gated=True, division=division))
    best = best_static(find, SUSPENDING.name, load, gated=True)
    comparison = _Comparison()
    if ours and best:
        static, before = best.figures, best.figures.critical()
        for context, hit in ours.critical().items():
            text = f"{context}: {hit:.1%}, {before[context]:.1%} under {best.division}"
            comparison.check(text, holds=hit >= before[context] - POINT - ROUNDING)
        for task in (task.name for task in ours.tasks.values() if task.protected):
            text = f"{task}: {ours.hit(task):.1%}, {static.hit(task):.1%} under {best.division}"
            comparison.check(text, holds=ours.hit(task) >= static.hit(task) - POINT - ROUNDING)
    return comparison.verdict(f"equal gating: {SUSPENDING.name}, load {load:g}, against the best static", division)


def static_that_serve_all(find: Find, load: float) -> Sequence[str] | None:
    """Which static divisions keep every context's critical task, as `heavy` asks; None if none was measured."""
    judged = [heavy(find, load, division) for division in STATIC]
    measured = [verdict for verdict in judged if verdict.compared]
    return [verdict.division for verdict in measured if verdict.met] if measured else None


def _gating(gated: bool) -> str:  # noqa: FBT001 - says it in words
    return "gated" if gated else "ungated"
