"""What earlier runs say of the next one: how fast its processors will be, and how much work its inputs are. Pure.

The threads that keep the processors at a pace judge their speed by a small loop. Where a neighbour on the host slows
that loop and not the tasks, these get more than the pace, and the loop can't know. The work that the same inputs took
does not rest on the loop being right: it is the same in every run, but for a few percent.
"""

from __future__ import annotations

from collections import defaultdict, deque
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.capacity import WHOLE, Capacity
from timelines.experiments.configurations import ALONE, CONFIGURATIONS
from timelines.experiments.machine import kind, this_machine
from timelines.experiments.metrics import Pair, cpu_per_input

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from timelines.experiments.metrics import Run
    from timelines.experiments.record import Record

LATEST = 3
"""Runs whose median says how fast the next one will be: a single one may have been disturbed."""
FEW = 5
"""Runs of a story under a load that are too few to say how much work its inputs are."""
OFF = 0.12
"""How far a run's work for the same inputs may be from the median of runs like it: of 90 runs 88 were within it, and
two were 15 and 26 % below it. Under limits, which leave the tasks little to contend for, it is up to a tenth less."""


class Kind(NamedTuple):
    """Runs whose processors are alike: under limits, which leave them idle, they turned out slower than else."""

    machine: str
    capacity: Capacity
    limited: bool

    @classmethod
    def of(cls, record: Record) -> Kind:
        """A run's."""
        about = record.about
        return cls(kind(about["machine"]), Capacity(*about["capacity"]), _limited(record.configuration))

    @classmethod
    def here(cls, capacity: Capacity, configuration: str) -> Kind:
        """That of a run on this machine."""
        return cls(kind(this_machine()), capacity, _limited(configuration))


class Alike(NamedTuple):
    """Runs in which the same inputs are as much work: machines differ in it by more than the rule allows."""

    machine: str
    load: str
    story: str
    limited: bool
    adaptive: bool


class Earlier:
    """The runs so far."""

    def __init__(self, runs: Iterable[Run] = ()) -> None:
        self._speeds: dict[Kind, deque[float]] = defaultdict(lambda: deque(maxlen=LATEST))
        self._first: dict[str, Run] = {}
        self._works: dict[Alike, list[float]] = defaultdict(list)
        for run in sorted(runs, key=lambda run: str(run.record.about["date"])):
            self.add(run)

    def add(self, run: Run) -> None:
        """Note a run that counts."""
        self.note_speed(run.record)
        work = self._work(run)
        if work is not None and run.record.configuration != ALONE.name:
            self._works[_alike(run.record)].append(work)
        self._first.setdefault(run.record.story, run)

    def note_speed(self, record: Record) -> None:
        """Note how fast the processors were, also in an attempt that does not count: the next one follows it."""
        self._speeds[Kind.of(record)].append(float(record.about["pace"]["speed"]))

    def expected(self, wanted: Kind) -> float:
        """How fast such processors will be, in turns of the loop in a second of CPU.

        If no run was like it, as fast as others on this machine; a whole one before the first run. What a processor
        does just before a run, with nothing on it, says less: it was 0.6 to 1.5 times what it did in the run.
        """
        others = [one for own, speeds in self._speeds.items() if own.machine == wanted.machine for one in speeds]
        return median(self._speeds.get(wanted) or others or [WHOLE])

    def reasons(self, run: Run) -> Iterator[str]:
        """Why a run does not count: its inputs took another amount of work than those of most runs."""
        part = self.part(run)
        if abs(part - 1) > OFF:
            least, most = 1 - OFF, 1 + OFF
            yield f"the same inputs took {part:.0%} of other runs' work: expected {least:.0%} to {most:.0%}"

    def part(self, run: Run) -> float:
        """A run's work for the same inputs, as a part of the median of runs like it; 1 where these are too FEW."""
        works, work = self._works[_alike(run.record)], self._work(run)
        if work is None or len(works) < FEW or run.record.configuration == ALONE.name:
            return 1.0
        return work / median(works)

    def _work(self, run: Run) -> float | None:
        """As a multiple of the story's first run, for inputs that both did; None where there are none."""
        first = self._first.get(run.record.story, run)
        found = cpu_per_input(Pair(run.schedule, run.record, first.record))
        return found["all tasks"].value if found else None


def _alike(record: Record) -> Alike:
    """Of which runs the work for the same inputs should be about the same: modules that adapt do less when late."""
    adaptive = CONFIGURATIONS[record.configuration].adaptive
    machine = kind(record.about["machine"])
    return Alike(machine, record.load, record.story, limited=_limited(record.configuration), adaptive=adaptive)


def _limited(configuration: str) -> bool:
    """Whether it leaves processors idle."""
    return CONFIGURATIONS[configuration].control == "Limit"
