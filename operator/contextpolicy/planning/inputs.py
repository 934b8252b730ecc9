"""Everything that can happen to a planner besides a sample and a due timer."""

from __future__ import annotations

from dataclasses import dataclass

from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.policy.fields import LARGEST


@dataclass(frozen=True, slots=True)
class Gone:
    """A stream's liveliness token disappeared: its sender is dead or unreachable."""

    stream: str


@dataclass(frozen=True, slots=True)
class Score:
    """A plugged-in instantiation function produced a score for a task's n-th activity.

    `arrived` is that of the sample that the function is reacting to; None when it emits on its own.
    """

    task: str
    activity: int
    value: float
    arrived: float | None = None

    @property
    def is_number(self) -> bool:
        """Whether the value is a finite number: foreign code may emit NaN, infinity, or no number at all."""
        return isinstance(self.value, int | float) and abs(self.value) <= LARGEST


@dataclass(frozen=True, slots=True)
class ClockSet:
    """The wall clock was set: planning time is now `ahead` seconds of it."""

    ahead: float


Input = Sample | Placement | Gone | Score | ClockSet
