"""The goals, and whether the figures meet them. Pure.

Only cells of the same gating are compared, over the blocks that they have in common. A goal is met when the whole 95 %
interval of each figure is within its bound, missed when that of one is beyond it, and else not shown: what a machine
does varies from block to block, and a figure beside its bound says nothing. A goal whose cells are not all there is not
judged, and neither is one whose cells were measured at different times (see `intervals`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from tests.bench.enforcement.divisions import ALONE, DEFAULT, STATIC, SUSPENSION, WEIGHTS
from tests.bench.enforcement.inputs import Queue
from tests.bench.enforcement.intervals import RESAMPLES, Paired, interval
from tests.bench.enforcement.matrix import HEAVY, LIGHT, Cell
from tests.bench.enforcement.opponents import best_static
from tests.bench.enforcement.policy import ATTEMPTS
from tests.bench.enforcement.stories import IMPORTANCE, SUSPENDING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from tests.bench.enforcement.intervals import Drawn, Interval
    from tests.bench.enforcement.opponents import Find

POINT = 0.01
SLOWER, LATER = 1.2, 0.005
"""How much a p99 may grow under light load: by a factor, and seconds more."""
KEPT = 0.97
"""Of what the critical task hits alone, and of the work that Linux default gets done."""
ROUNDING = 1e-9
FEWEST = 5
"""Blocks that a verdict takes: of fewer, what was drawn is no measure of how much they vary."""


class Outcome(StrEnum):
    """What became of a goal."""

    MET = "met"
    NOT_SHOWN = "not shown"
    MISSED = "missed"
    NOT_MEASURED = "not measured"
    NOT_COMPARABLE = "not judged: its blocks are not interleaved"


@dataclass(frozen=True, slots=True)
class Verdict:
    """One goal for one division, over so many blocks: every figure that was compared, and those not within bounds."""

    goal: str
    division: str
    outcome: Outcome
    blocks: int
    compared: tuple[str, ...]
    failed: tuple[str, ...]


class _Comparison:
    """Collects what was compared: margins, of which less than 0 is beyond the bound."""

    def __init__(self, paired: Paired | None) -> None:
        self._blocks = len(paired.blocks) if paired else 0
        self._interleaved = paired is not None and paired.interleaved
        self._all: list[str] = []
        self._failed: list[str] = []
        self._outcomes: set[Outcome] = set()

    def hit(self, what: str, now: NDArray[np.float64], before: NDArray[np.float64], least: NDArray[np.float64]) -> None:
        """A hit rate, and the least that it may be."""
        self._check(what.format(now=f"{now[0]:.1%}", before=f"{before[0]:.1%}"), now - least, 100, "points")

    def p99(self, what: str, now: NDArray[np.float64], before: NDArray[np.float64]) -> None:
        """A response time, beside that under Linux' default; never is no worse than never."""
        most = before * SLOWER + LATER
        text = what.format(now=f"{now[0] * 1000:.1f} ms", before=f"{before[0] * 1000:.1f} ms")
        with np.errstate(invalid="ignore"):  # never, less never
            self._check(text, np.where(np.isposinf(most), inf, most - now), 1000, "ms")

    def work(self, what: str, now: NDArray[np.float64], before: NDArray[np.float64]) -> None:
        """CPU seconds."""
        self._check(what.format(now=f"{now[0]:.2f}", before=f"{before[0]:.2f}"), now - KEPT * before, 1, "CPU s")

    def verdict(self, goal: str, division: str) -> Verdict:
        return Verdict(goal, division, self._outcome(), self._blocks, tuple(self._all), tuple(self._failed))

    def _check(self, what: str, margins: NDArray[np.float64], scale: float, unit: str) -> None:
        margin = interval(margins)
        outcome = _judged(margin)
        whole, least, most = (f"{scale * value:+.2f}" for value in (margin.whole, margin.least, margin.most))
        text = f"{what}; margin {whole} ({least} to {most}) {unit}"
        self._all.append(text)
        self._outcomes.add(outcome)
        if outcome is not Outcome.MET or margin.whole < -ROUNDING:
            self._failed.append(f"{outcome}: {text}")

    def _outcome(self) -> Outcome:
        if not self._all:
            return Outcome.NOT_MEASURED
        if not self._interleaved:
            return Outcome.NOT_COMPARABLE
        if self._blocks < FEWEST:
            return Outcome.NOT_SHOWN
        return next(one for one in (Outcome.MISSED, Outcome.NOT_SHOWN, Outcome.MET) if one in self._outcomes)


def verdicts(find: Find, resamples: int = RESAMPLES) -> list[Verdict]:
    """All goals for context weights, the first law for suspension alone, and the attempts if they were measured."""
    found = [
        verdict
        for division in (WEIGHTS, *ATTEMPTS)
        for verdict in (
            first_law(find, IMPORTANCE.name, division, gated=False, resamples=resamples),
            first_law(find, SUSPENDING.name, division, gated=True, resamples=resamples),
            *(heavy(find, load, division, resamples) for load in HEAVY),
            *(no_worse_than_static(find, load, division, resamples) for load in HEAVY),
        )
    ]
    found.append(first_law(find, SUSPENDING.name, SUSPENSION, gated=True, resamples=resamples))
    return [one for one in found if one.division not in ATTEMPTS or one.compared]


def first_law(find: Find, story: str, division: str, *, gated: bool, resamples: int = RESAMPLES) -> Verdict:
    """Light load: nobody that runs loses more than a point or gets much slower, compared with plain Linux."""
    paired = _paired(find, (Cell(story, LIGHT, Queue.NEWEST, gated, name) for name in (division, DEFAULT)), resamples)
    comparison = _Comparison(paired)
    if paired:
        ours, plain = paired.drawn
        for task in plain.figures.tasks:
            now, before = ours.hit(task), plain.hit(task)
            comparison.hit(f"{task} hits {{now}}, {{before}} under Linux default", now, before, before - POINT)
            now, before = ours.quantile(task, 0.99), plain.quantile(task, 0.99)
            comparison.p99(f"{task} p99 {{now}}, {{before}} under Linux default", now, before)
    return comparison.verdict(f"first law: {story}, load {LIGHT:g}, {_gating(gated)}", division)


def heavy(find: Find, load: float, division: str, resamples: int = RESAMPLES) -> Verdict:
    """Heavy load, nothing suspended: each context's critical task keeps its hits, and the work is still done."""
    names = (division, ALONE, DEFAULT)
    cells = (Cell(IMPORTANCE.name, load, Queue.NEWEST, gated=False, division=name) for name in names)
    paired = _paired(find, cells, resamples)
    comparison = _Comparison(paired)
    if paired:
        ours, alone, plain = paired.drawn
        undisturbed = _critical(alone)
        for context, hit in _critical(ours).items():
            text = f"{context}: {{now}} of inputs hit, {{before}} alone"
            comparison.hit(text, hit, undisturbed[context], KEPT * undisturbed[context])
        comparison.work("work {now} CPU s, {before} under Linux default", ours.work(), plain.work())
    return comparison.verdict(f"heavy: {IMPORTANCE.name}, load {load:g}, nothing suspended", division)


def no_worse_than_static(find: Find, load: float, division: str, resamples: int = RESAMPLES) -> Verdict:
    """With equal gating: critical and protected tasks lose at most a point against the best static division."""
    best = best_static(find, SUSPENDING.name, load, gated=True)
    names = (division, best.division) if best else ()
    cells = (Cell(SUSPENDING.name, load, Queue.NEWEST, gated=True, division=name) for name in names)
    paired = _paired(find, cells, resamples) if best else None
    comparison = _Comparison(paired)
    if paired and best:
        ours, static = paired.drawn
        before = _critical(static)
        for context, hit in _critical(ours).items():
            text = f"{context}: {{now}}, {{before}} under {best.division}"
            comparison.hit(text, hit, before[context], before[context] - POINT)
        for task in (task.name for task in ours.figures.tasks.values() if task.protected):
            now, then = ours.hit(task), static.hit(task)
            comparison.hit(f"{task}: {{now}}, {{before}} under {best.division}", now, then, then - POINT)
    return comparison.verdict(f"equal gating: {SUSPENDING.name}, load {load:g}, against the best static", division)


def statics(find: Find, load: float, resamples: int = RESAMPLES) -> Mapping[str, Outcome]:
    """Whether each static division that was measured keeps every context's critical task, as `heavy` asks."""
    judged = [heavy(find, load, division, resamples) for division in STATIC]
    return {verdict.division: verdict.outcome for verdict in judged if verdict.compared}


def _paired(find: Find, cells: Iterable[Cell], resamples: int) -> Paired | None:
    """What the cells have in common; None if there is nothing."""
    found = [find(cell) for cell in cells]
    measured = [figures for figures in found if figures is not None]
    paired = Paired(*measured, resamples=resamples) if len(measured) == len(found) else None
    return paired if paired and paired.blocks else None


def _critical(drawn: Drawn) -> dict[str, NDArray[np.float64]]:
    """Each context's own task in it."""
    return {one.name: drawn.hit(one.critical, [one.name]) for one in drawn.figures.story.contexts}


def _judged(margin: Interval) -> Outcome:
    if margin.least >= -ROUNDING:
        return Outcome.MET
    return Outcome.MISSED if margin.most < -ROUNDING else Outcome.NOT_SHOWN


def _gating(gated: bool) -> str:  # noqa: FBT001 - says it in words
    return "gated" if gated else "ungated"
