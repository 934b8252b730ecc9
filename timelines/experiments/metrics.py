"""What is compared between two runs of a block. Pure: each measure gives, by case, the run's value and the other's.

A rate is over the inputs that their context wants, by the timeline. What was never done has a response time of NEVER.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from timelines.experiments.accounting import Ended, Tally, cpu_of_same, quantile, wanted
from timelines.experiments.capacity import WHOLE
from timelines.experiments.due import TENTHS
from timelines.experiments.stories import CRITICAL, PROTECTED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from timelines.experiments.due import Schedule
    from timelines.experiments.record import Record

NEVER = 60.0
"""Seconds: as long as a story, so that what was never done can be compared."""
FEW = 100
"""Inputs of which one in a hundred is less than one."""
POINTS_PER_METRE = 2.0
"""A trajectory error of a centimetre weighs as much as two points of a rate."""


class Case(NamedTuple):
    """A value, and the one that it is compared with; `due` is how many inputs or events they are of."""

    value: float
    base: float
    due: float = 1.0


@dataclass(frozen=True, slots=True)
class Pair:
    """Two runs of the same story in the same block."""

    schedule: Schedule
    record: Record
    base: Record

    def both(self, measure: Callable[..., float], *what: str) -> Case:
        """A measure of both, of a task or of a task in a context."""
        own, base = Run(self.schedule, self.record), Run(self.schedule, self.base)
        return Case(measure(own, *what), measure(base, *what), own.tally(*what).due)


@dataclass(frozen=True, slots=True)
class Run:
    """A run beside what was due in it."""

    schedule: Schedule
    record: Record

    @property
    def speed(self) -> float:
        """How fast its processors were, as a multiple of a whole one: CPU seconds count as so many of that."""
        return float(self.record.about["pace"]["speed"]) / self.whole

    @property
    def whole(self) -> float:
        """What counted as a whole processor on its machine, in turns a second."""
        return float(self.record.about.get("whole", WHOLE))

    def ended(self, task: str) -> list[Ended]:
        """How all of a task's inputs ended."""
        return self.record.ended(self.schedule, task, self.schedule.deadlines.get(task, math.inf))

    def wanted(self, task: str, context: str | None = None, *, onset: bool | None = None) -> list[Ended]:
        """How those ended that their context wants."""
        return wanted(self.schedule.of(task), self.ended(task), context, onset=onset)

    def tally(self, task: str, context: str | None = None, *, onset: bool | None = None) -> Tally:
        """The same, counted."""
        return Tally.of(one.ending for one in self.wanted(task, context, onset=onset))

    def covered(self, task: str, context: str | None = None) -> float:
        """The part of what its context wants that was done at all; of SLAM's frames, with a pose that it trusts."""
        if task != "slam" or not self.record.trusted:
            return self.tally(task, context).coverage
        due = zip(self.schedule.of(task), self.record.trusted, strict=True)
        letters = [letter for one, letter in due if one.wanted and context in (None, one.context)]
        return letters.count("1") / len(letters) if letters else math.nan

    def tail(self, task: str) -> float:
        """Seconds that the slow ones took, at most NEVER: p99, or p90 where p99 of FEW inputs would be a single one."""
        ended = self.wanted(task)
        return min(quantile(ended, 0.99 if len(ended) >= FEW else 0.9), NEVER)

    def commands(self, context: str) -> tuple[int, list[float]]:
        """Frames that are due in a context, and the seconds from each to its wheel command, where there was one."""
        frames = [one for one in self.schedule.of("slam") if one.context == context and one.wanted]
        numbers = {one.number for one in frames}
        return len(frames), [late / TENTHS for number, late in self.record.commands if number in numbers]


def contexts(schedule: Schedule) -> dict[str, str]:
    """Each context of a story that is about a task, with that task."""
    about = [(window.name, name) for window in schedule.windows for name in window.contexts if name in CRITICAL]
    return {context: CRITICAL[name] for context, name in about}


def critical_hits(pair: Pair) -> dict[str, Case]:
    """The part of the critical task's inputs that was done in time, in each context."""
    return {f"{context}: {task}": pair.both(_hit, task, context) for context, task in contexts(pair.schedule).items()}


def worst_context(pair: Pair) -> dict[str, Case]:
    """The same in the context where it is least."""
    found = critical_hits(pair).values()
    return {"worst context": Case(min(one.value for one in found), min(one.base for one in found))} if found else {}


def hits(pair: Pair) -> dict[str, Case]:
    """The same of every task, over the whole story."""
    return {task: pair.both(_hit, task) for task in _asked(pair)}


def slowest(pair: Pair) -> dict[str, Case]:
    """How long the slow inputs of every task took."""
    return {task: pair.both(Run.tail, task) for task in _asked(pair)}


def coverage(pair: Pair) -> dict[str, Case]:
    """The part that came to something: of the critical task in its context, and of the protected ones throughout."""
    critical = {
        f"{context}: {task}": pair.both(Run.covered, task, context) for context, task in contexts(pair.schedule).items()
    }
    protected = {task: pair.both(Run.covered, task) for task in PROTECTED if task in pair.schedule.inputs}
    return critical | protected


def accuracy(pair: Pair) -> dict[str, Case]:
    """How right the critical and the protected tasks were, as rates; a task without results was wrong throughout.

    A critical task is judged in its own context where each result belongs to one, else over the whole story.
    """
    both = pair.record.accuracy.keys() | pair.base.accuracy.keys()
    own = {f"{context}: {task}": task for context, task in contexts(pair.schedule).items()}
    apart = {task for name, task in own.items() if name in both}
    judged = own.keys() | ({*PROTECTED, *own.values()} - apart)
    return {
        task: Case(_rate(pair.record.accuracy.get(task)), _rate(pair.base.accuracy.get(task)), _events(pair, task))
        for task in sorted(judged & both)
    }


def cpu_per_input(pair: Pair) -> dict[str, Case]:
    """CPU that all tasks took for those inputs that both runs did, at the same speed, as a multiple of the other's."""
    own, its = Run(pair.schedule, pair.record), Run(pair.schedule, pair.base)
    before = after = 0.0
    for task in pair.schedule.inputs:
        one, other = cpu_of_same(its.ended(task), own.ended(task))
        before, after = before + one, after + other
    return {"all tasks": Case(after * own.speed / (before * its.speed), 1.0)} if before else {}


def _hit(run: Run, task: str, context: str | None = None) -> float:
    return run.tally(task, context).hit


def _rate(judged: Sequence[Any] | None) -> float:
    """From 0 to 1: nothing is worse than no result."""
    if judged is None:
        return 0.0
    _, value, unit, *_ = judged
    return max(0.0, 1 - POINTS_PER_METRE * float(value)) if unit == "m" else float(value) / 100


def _events(pair: Pair, task: str) -> float:
    """How many signs, commands or states were judged; a trajectory is one."""
    judged = pair.base.accuracy.get(task) or pair.record.accuracy[task]
    return 1.0 if judged[2] == "m" else float(judged[3])


def _asked(pair: Pair) -> list[str]:
    """The tasks of which anything is due in a context that wants it."""
    return [task for task in pair.schedule.inputs if any(one.wanted for one in pair.schedule.of(task))]


METRICS: Mapping[str, Callable[[Pair], dict[str, Case]]] = {
    "critical hit rate": critical_hits,
    "worst context": worst_context,
    "hit rate": hits,
    "tail": slowest,
    "coverage": coverage,
    "accuracy": accuracy,
    "CPU per same input": cpu_per_input,
}
