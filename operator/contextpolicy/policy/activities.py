"""When a task matters, and what it needs to run, as frozen values (paper III, IV-D)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.policy.field_types import Cel, Cpu, Memory, Seconds, Weighting


class Enforce(StrEnum):
    """What happens to a task whose needs can't be met: it is kept and reported, or suspended (paper III)."""

    REPORT = "Report"
    SUSPEND = "Suspend"


@dataclass(frozen=True, slots=True)
class Activity:
    """An event-driven initiative: a score while its event is fresh (paper III, IV-D).

    With `hold` a matching sample counts that long; without it, until a sample does not match or the stream is silent.
    With `until` it counts, at most for `hold` if there is one, until that condition holds. `decay` then lets the score
    fall to zero linearly. `initiative` names a plugged-in instantiation function instead.
    """

    when: Cel = "true"
    until: Cel | None = None
    stream: str | None = None
    score: Weighting = 1.0
    score_from: Cel | None = None
    hold: Seconds = 0.0
    decay: Seconds = 0.0
    initiative: str | None = None
    arguments: Mapping[str, str] = field(default_factory=dict)

    @property
    def counts(self) -> bool:
        """Whether it may ever score more than 0."""
        return self.exceeds(0)

    def exceeds(self, score: float) -> bool:
        """Whether it may ever score more than this."""
        return self.score > score or self.score_from is not None or self.initiative is not None

    @property
    def outlasts(self) -> bool:
        """Whether it may count while its `when` does not hold."""
        return bool(self.hold or self.decay or self.until or self.initiative)


@dataclass(frozen=True, slots=True)
class Requirement:
    """A pre-condition: without it the task's weight is 0. A matching sample counts for `hold`.

    With `task` it is an edge of the task graph instead: that task must be able to run.
    """

    when: Cel = "true"
    hold: Seconds = 0.0
    task: str | None = None


@dataclass(frozen=True, slots=True)
class Needs:
    """Capability constraints: what the task must get to be of any use (paper III)."""

    cores: Cpu | None = None
    memory: Memory | None = None
    deadline: Seconds | None = None
    enforce: Enforce = Enforce.REPORT
