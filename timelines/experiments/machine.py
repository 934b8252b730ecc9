"""How fast a whole processor is on this machine, from what the tasks themselves take there. Pure.

Machines differ in the speed of a small loop by more than in that of the tasks, which also wait for memory: where the
loop ran 1.7 times as fast, the same inputs took 1.25 times as many of its turns. With as many turns a second as during
calibration the tasks would ask for a quarter more than was frozen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from timelines.experiments.calm import DisturbedError
from timelines.experiments.capacity import WHOLE
from timelines.experiments.metrics import Pair, Run, cpu_per_input

if TYPE_CHECKING:
    from collections.abc import Callable

CLOSE = 0.03
"""How far the work for the same inputs may be from the calibration's."""
TRIES = 4


class Machine(NamedTuple):
    """How fast a processor is here: so many turns of the loop a second count as a whole one.

    Beside the tasks it does only the part `beside` of what it does undisturbed: a limit hands out CPU time of that.
    """

    whole: float = WHOLE
    beside: float = 1.0


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


def beside(run: Run) -> float:
    """The part of its speed just before a run, undisturbed, that a processor had in it."""
    return run.speed / float(run.record.about["undisturbed"])


def _work(run: Run, reference: Run) -> float:
    return cpu_per_input(Pair(run.schedule, run.record, reference.record))["all tasks"].value
