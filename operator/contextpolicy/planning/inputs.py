"""Everything that can happen to a planner besides a sample and a due timer."""

from __future__ import annotations

from dataclasses import dataclass

from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.conditions.sample import Sample


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


Input = Sample | Placement | Gone | Score
