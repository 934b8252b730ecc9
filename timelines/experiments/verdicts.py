"""Whether the goals are met, block by block. Pure."""

from __future__ import annotations

from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.goals import GOALS, SIGNIFICANT, Goal
from timelines.experiments.metrics import METRICS
from timelines.experiments.paired import Interval, bootstrap, holm, sign_flip

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from timelines.experiments.evidence import Evidence
    from timelines.experiments.metrics import Case


class Judged(NamedTuple):
    """One case of a goal: means of both values over blocks and stories, the gain over what is asked, and p."""

    name: str
    value: float
    base: float
    gain: Interval
    probability: float


class Verdict(NamedTuple):
    """A goal with its cases, and the probability of the least sure one, corrected for the number of goals.

    `enough` is whether there are enough blocks to decide: that they all agree would then be significant.
    """

    goal: Goal
    cases: Sequence[Judged]
    probability: float
    enough: bool

    @property
    def met(self) -> bool | None:
        """None where nothing was measured, or nothing is shown either way; what surely falls short is missed."""
        if self.probability <= SIGNIFICANT:
            return True
        return False if any(_falls_short(case.gain) for case in self.cases) else None

    @property
    def worst(self) -> Judged | None:
        """The least sure case."""
        return max(self.cases, key=lambda case: (case.probability, -case.gain.low), default=None)


def _falls_short(gain: Interval) -> bool:
    """Whether the interval is below what is asked, of as many blocks as an exact test needs."""
    return gain.high < 0 and 0.5**gain.pairs <= SIGNIFICANT


def verdicts(evidence: Evidence, goals: Sequence[Goal] = GOALS) -> list[Verdict]:
    """All goals; one without runs counts in the correction as well, so that leaving runs out gains nothing."""
    cases = {goal.name: judged(evidence, goal) for goal in goals}
    raw = {name: max((case.probability for case in own), default=1.0) for name, own in cases.items()}
    corrected = holm(raw)
    return [Verdict(goal, cases[goal.name], corrected[goal.name], _enough(cases[goal.name], goals)) for goal in goals]


def _enough(cases: Sequence[Judged], goals: Sequence[Goal]) -> bool:
    """Whether blocks that all agree would be significant among so many goals."""
    fewest = min((case.gain.pairs for case in cases), default=0)
    return bool(cases) and len(goals) * 0.5**fewest <= SIGNIFICANT


def judged(evidence: Evidence, goal: Goal) -> list[Judged]:
    """Each case of a goal. The block is the unit: its stories count by what is due in them.

    Where a run is compared with several, the comparison counts that it does worst in: a single bad run of a task alone
    must not lower what is asked of all blocks.
    """
    found: dict[str, dict[int, dict[str, Case]]] = {}
    for block, pair in evidence.pairs(goal.load, goal.configuration, goal.against):
        for name, case in METRICS[goal.metric](pair).items():
            own = found.setdefault(name, {}).setdefault(block, {})
            own[pair.record.story] = min(own.get(pair.record.story, case), case, key=lambda one: _gain(goal, one))
    return [_judged(goal, name, blocks) for name, blocks in found.items()]


def _gain(goal: Goal, case: Case) -> float:
    return goal.gain(case.value, case.base)


def _judged(goal: Goal, name: str, blocks: Mapping[int, Mapping[str, Case]]) -> Judged:
    stories = [list(cases.values()) for cases in blocks.values()]
    gains = [_mean([_gain(goal, case) for case in cases], cases) for cases in stories]
    every = [case for cases in stories for case in cases]
    value, base = (_mean([case[place] for case in every], every) for place in (0, 1))
    return Judged(name, value, base, bootstrap(gains), sign_flip(gains))


def _mean(values: Sequence[float], cases: Sequence[Case]) -> float:
    return fmean(values, [case.due for case in cases])
