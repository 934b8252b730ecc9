"""How fast a processor is on this machine: what counts as a whole one, and what one does in a run. Pure.

Machines differ in the speed of a small loop by more than in that of the tasks, which also wait for memory: where the
loop ran 1.7 times as fast, the same inputs took 1.25 times as many of its turns. With as many turns a second as during
calibration the tasks would ask for a quarter more than was frozen.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import TYPE_CHECKING

from timelines.experiments.calm import DisturbedError
from timelines.experiments.capacity import WHOLE
from timelines.experiments.metrics import Pair, Run, cpu_per_input

if TYPE_CHECKING:
    from collections.abc import Callable

    from timelines.experiments.capacity import Capacity

CLOSE = 0.03
"""How far the work for the same inputs may be from the calibration's."""
TRIES = 4
LATEST = 5
"""Runs whose median says how fast the next one will be: a single one may have been disturbed."""


class Speeds:
    """How fast the processors were in the latest runs, in turns of the loop in a second of CPU.

    What one does just before a run, with nothing on it, says less: it was 0.6 to 1.5 times what it did in the run.
    """

    def __init__(self) -> None:
        self._all: deque[float] = deque(maxlen=LATEST)
        self._of: dict[Capacity, deque[float]] = {}

    def add(self, capacity: Capacity, speed: float) -> None:
        """Note how fast they were in a run on such processors."""
        self._all.append(speed)
        self._of.setdefault(capacity, deque(maxlen=LATEST)).append(speed)

    def expected(self, capacity: Capacity) -> float:
        """How fast such processors will be, or any, if none was like them; a whole one before the first run."""
        return median(self._of.get(capacity) or self._all or [WHOLE])


def whole_here(reference: Run, play: Callable[[float], Run]) -> float:
    """As many turns a second of the loop as make the tasks' work for the same inputs the calibration's.

    `reference` is the calibration's run of each task alone, `play` repeats it, with what counts as a whole processor.
    DisturbedError if no two runs agree: this machine changes faster than it can be measured.
    """
    whole = reference.whole
    for _ in range(TRIES):
        times = _work(play(whole), reference)
        if abs(times - 1) <= CLOSE:
            return whole
        whole *= times
    raise DisturbedError(
        f"the tasks took {times:.0%} of the calibration's work after {TRIES} runs: expected about 100%"
    )


def _work(run: Run, reference: Run) -> float:
    return cpu_per_input(Pair(run.schedule, run.record, reference.record))["all tasks"].value
