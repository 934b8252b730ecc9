"""How every input that was due ended, and the rates that follow. Pure.

An input that its context wants and that was dropped, lost or suspended is a miss: the denominator is what was due.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from timelines.experiments.due import Due


class Ending(StrEnum):
    """What became of an input that was due."""

    IN_TIME = "in time"
    LATE = "late"
    DROPPED = "dropped"
    """By its task: a newer one took its place in the queue, or the queue was emptied when the task was suspended."""
    SUSPENDED = "suspended"
    """By decision: it came while the task was suspended."""
    LOST = "lost"
    """On the way: the bus does not keep what a starved subscriber does not fetch, and a task that has just resumed has
    not subscribed yet."""


class Timing(NamedTuple):
    """An input that was done: when (Unix seconds), the CPU seconds, and what its task had dropped of it by then."""

    finished: float
    cpu: float
    dropped: int


class Ended(NamedTuple):
    """How an input ended; where it was done, with the seconds from its stamp to its result, and those of CPU."""

    ending: Ending
    response: float | None = None
    cpu: float | None = None


@dataclass(frozen=True, slots=True)
class Heard:
    """What is known of one input of a task after a run. `stamps` are the player's, ns since 1970, one for each due.

    `done` is by stamp, `away` when the run's decisions suspended the task (Unix seconds, ascending), `dropped` how many
    the task had dropped in the end, `deadline` in seconds (infinite: none).
    """

    stamps: Sequence[int]
    done: Mapping[int, Timing]
    away: Sequence[tuple[float, float]] = ()
    dropped: int = 0
    deadline: float = math.inf

    def endings(self) -> list[Ended]:
        """One for each input that was due."""
        later = sorted(stamp for stamp in self.stamps if stamp in self.done)
        spent, found = 0, []
        for stamp in self.stamps:
            timing = self.done.get(stamp)
            if timing is not None:
                found.append(self._done(stamp, timing))
                continue
            place = bisect_right(later, stamp)
            newer = self.done[later[place]] if place < len(later) else None
            ending = self._undone(stamp / 1e9, newer, spent)
            spent += ending is Ending.DROPPED
            found.append(Ended(ending))
        return found

    def _done(self, stamp: int, timing: Timing) -> Ended:
        response = timing.finished - stamp / 1e9
        return Ended(Ending.IN_TIME if response <= self.deadline else Ending.LATE, response, timing.cpu)

    def _undone(self, at: float, newer: Timing | None, spent: int) -> Ending:
        """`newer` is the next input that was done, `spent` how many drops are explained.

        The task counts its drops and does not name them. Its counter, when the next input is done, has all that were
        dropped before that one: what exceeds it was lost. So totals are right, and the place is within a gap.
        """
        if any(begin <= at < end for begin, end in self.away):
            return Ending.SUSPENDED
        until = newer.finished if newer else math.inf
        if any(at < begin < until for begin, _ in self.away):
            return Ending.DROPPED
        return Ending.DROPPED if spent < (newer.dropped if newer else self.dropped) else Ending.LOST


@dataclass(frozen=True, slots=True)
class Tally:
    """How many inputs ended how."""

    counts: Mapping[Ending, int]

    @classmethod
    def of(cls, endings: Iterable[Ending]) -> Tally:
        """Count them."""
        return cls(Counter(endings))

    @property
    def due(self) -> int:
        """All of them."""
        return sum(self.counts.values())

    def count(self, *endings: Ending) -> int:
        """Those that ended in one of these ways."""
        return sum(self.counts.get(ending, 0) for ending in endings)

    @property
    def hit(self) -> float:
        """The part that was done in time; NaN if none was due."""
        return self.count(Ending.IN_TIME) / self.due if self.due else math.nan

    @property
    def coverage(self) -> float:
        """The part that was done at all; NaN if none was due."""
        return self.count(Ending.IN_TIME, Ending.LATE) / self.due if self.due else math.nan


def wanted(
    due: Iterable[Due], ended: Iterable[Ended], context: str | None = None, *, onset: bool | None = None
) -> list[Ended]:
    """The endings of those inputs that their context wants: in one context or all, at its onset, after it, or both."""
    return [
        end
        for one, end in zip(due, ended, strict=True)
        if one.wanted and context in (None, one.context) and onset in (None, one.onset)
    ]


def quantile(ended: Sequence[Ended], part: float) -> float:
    """Seconds within which that part of the inputs was done; infinite if fewer were, NaN if none was due."""
    times = sorted(math.inf if one.response is None else one.response for one in ended)
    return times[math.ceil(part * len(times)) - 1] if times else math.nan


def cpu_of_same(before: Sequence[Ended], after: Sequence[Ended]) -> tuple[float, float]:
    """CPU seconds that two runs took for those inputs that both did; the same inputs, in the same order."""
    pairs = [
        (one.cpu, other.cpu)
        for one, other in zip(before, after, strict=True)
        if one.cpu is not None and other.cpu is not None
    ]
    return math.fsum(one for one, _ in pairs), math.fsum(other for _, other in pairs)
