"""What the project set out to reach, judged by the runs. Pure; the bounds were set before the first run."""

from __future__ import annotations

from itertools import pairwise
from statistics import mean
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments import measures
from timelines.experiments.configurations import BASELINE, CFS, RT, STATIC, VPA
from timelines.experiments.intervals import Interval, of_ratios, of_values, short
from timelines.experiments.trials import REAL_PACE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from timelines.experiments.accuracy import Accuracy
    from timelines.experiments.raw_data import RunData
    from timelines.experiments.series import Series

CRITICAL = "slam"
"""The task whose deadlines count while the robot moves (paper VI-A)."""
SPEEDUP, ON_EQUAL_WORK, FEWER_MISSES, MISSES, OVER_IDEAL = 1.42, 0.95, 0.1, 1.0, 1.15
SLACK = {"m": 0.01}
"""By how much a task may be less exact before it counts as lost; of counted things, one of them."""


class Verdict(NamedTuple):
    """A goal, what was measured, and whether it is met; None where the runs don't show it."""

    goal: str
    measured: str
    met: bool | None


def verdicts(every: Sequence[Series], configuration: str = CFS.name) -> Iterator[Verdict]:
    """The goals of one context-aware configuration, as far as there are runs to judge them by."""
    fast = [series for series in every if series.pace > REAL_PACE and series.of(configuration)]
    yield from _totals(fast, configuration)
    for series in every:
        if not series.of(configuration):
            continue
        yield from _equal_work(series, configuration)
        if series.pace == REAL_PACE:
            yield from _misses(series, configuration)
            yield from _ideal(series, configuration)
        yield from _accuracy(series, configuration)
        yield from _others(series, configuration)
        if configuration == CFS.name:
            yield from _realtime(series)


def speedup(baseline: RunData, run: RunData) -> float:
    """Total time of the baseline divided by the run's."""
    return measures.total_time(baseline) / measures.total_time(run)


def on_equal_work(baseline: RunData, run: RunData) -> float:
    """The same on the inputs that both processed."""
    before, after = measures.equal_work(baseline, run)
    return before / after if after else 1.0


def misses(run: RunData) -> float:
    """Percent of the critical task's deadlines that it misses while the robot moves."""
    return 100 * measures.response(run, CRITICAL, moving=True).misses


def _totals(fast: Sequence[Series], configuration: str) -> Iterator[Verdict]:
    ratios = {
        series.experiment: of_ratios(found) for series in fast if (found := series.paired(configuration, speedup))
    }
    for series in fast:
        if series.experiment in ratios:
            own, bound = ratios[series.experiment], _bound(series)
            goal = f"{series.title}: total time at least {SPEEDUP} x as short as Linux default's"
            yield Verdict(goal, f"{own} x; at most {short(bound)} x is possible", _at_least(own, SPEEDUP))
    ordered = [name for name in ("exp1", "exp2", "exp3") if name in ratios]
    if len(ordered) > 1:
        grows = all(ratios[a].middle > ratios[b].middle for a, b in pairwise(ordered))
        reported = " > ".join(f"{name} {short(ratios[name].middle)} x" for name in ordered)
        yield Verdict(
            "the speedup grows with length: " + " > ".join(ordered), reported if grows else f"not {reported}", grows
        )


def _bound(series: Series) -> float:
    """Inputs come as fast as they come: no scheduler ends before the last one."""
    return mean(measures.total_time(run) / (run.ended - run.started) for run in series.of(BASELINE))


def _equal_work(series: Series, configuration: str) -> Iterator[Verdict]:
    ratios = series.paired(configuration, on_equal_work)
    if ratios:
        found = of_ratios(ratios)
        goal = f"{series.title}: on equal work at least {ON_EQUAL_WORK} x of Linux default"
        yield Verdict(goal, f"{found} x", _at_least(found, ON_EQUAL_WORK))


def _misses(series: Series, configuration: str) -> Iterator[Verdict]:
    pairs = series.paired(configuration, lambda baseline, run: misses(run) - FEWER_MISSES * misses(baseline))
    if pairs:
        own, default = (
            of_values([misses(run) for run in series.of(configuration)]),
            mean(map(misses, series.of(BASELINE))),
        )
        goal = f"{series.title}: {CRITICAL} misses at most a tenth of Linux default's deadlines while the robot moves"
        yield Verdict(goal, f"{own} % against {short(default)} %", _at_most(of_values(pairs), 0))
        yield Verdict(f"{series.title}: and under {MISSES:g} %", f"{own} %", _at_most(own, MISSES))


def _ideal(series: Series, configuration: str) -> Iterator[Verdict]:
    if series.ideal is None:
        return
    ideal = series.ideal
    found = [measures.over_ideal(ideal, run, CRITICAL, moving=True) for run in series.of(configuration)]
    ratios = [ratio for ratio in found if ratio]
    if ratios:
        goal = f"{series.title}: {CRITICAL} answers within {OVER_IDEAL} x of what it takes alone, while the robot moves"
        yield Verdict(goal, f"{of_ratios(ratios)} x", _at_most(of_ratios(ratios), OVER_IDEAL))


def _accuracy(series: Series, configuration: str) -> Iterator[Verdict]:
    for task in series.first.inputs:
        pairs = [
            (before, after)
            for repeat, run in series.runs[configuration].items()
            if (baseline := series.runs.get(BASELINE, {}).get(repeat))
            and (before := series.accuracies[baseline].get(task))
            and (after := series.accuracies[run].get(task))
        ]
        if pairs:
            yield _exactness(series, task, pairs)


def _exactness(series: Series, task: str, pairs: Sequence[tuple[Accuracy, Accuracy]]) -> Verdict:
    """Whether a task became less exact by more than slack."""
    first = pairs[0][1]
    lost = mean((before.value - after.value) * (1 if after.more_is_better else -1) for before, after in pairs)
    slack = SLACK.get(first.unit, 100 / first.count)
    reported = [short(mean(one.value for one in column)) for column in zip(*pairs, strict=True)]
    goal = f"{series.title}: {task} is as exact as under Linux default ({first.measure})"
    return Verdict(goal, f"{reported[1]} {first.unit} against {reported[0]} {first.unit}", lost <= slack)


def _others(series: Series, configuration: str) -> Iterator[Verdict]:
    for other in (STATIC, VPA):
        ratios = series.paired(configuration, speedup, other.name)
        if ratios:
            fewer = of_values(series.paired(configuration, lambda its, own: misses(own) - misses(its), other.name))
            goal = f"{series.title}: better than {other.title} on misses and on total time"
            reported = f"{fewer} points of misses, {of_ratios(ratios)} x"
            yield Verdict(goal, reported, _both(_at_most(fewer, 0), _at_least(of_ratios(ratios), 1)))


def _realtime(series: Series) -> Iterator[Verdict]:
    ratios = series.paired(RT.name, speedup)
    if ratios:
        found = of_ratios(ratios)
        yield Verdict(f"{series.title}: RT CA is faster than Linux default", f"{found} x", _at_least(found, 1))


def _at_least(found: Interval, bound: float) -> bool | None:
    """By the interval; by the value where there is one pair only, which the report says."""
    return found.is_at_least(bound) if found.pairs > 1 else found.middle >= bound


def _at_most(found: Interval, bound: float) -> bool | None:
    return found.is_at_most(bound) if found.pairs > 1 else found.middle <= bound


def _both(one: bool | None, other: bool | None) -> bool | None:  # noqa: FBT001 - two of a kind
    return False if False in (one, other) else None if None in (one, other) else True
