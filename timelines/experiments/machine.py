"""What this machine is, and what counts as a whole processor on it.

Machines differ in the speed of a small loop by more than in that of the tasks, which also wait for memory: where the
loop ran 1.7 times as fast, the same inputs took 1.25 times as many of its turns. With as many turns a second as during
calibration the tasks would ask for a quarter more than was frozen.
"""

from __future__ import annotations

import os
import platform
from statistics import median
from typing import TYPE_CHECKING, Any

from robotkit.profile import processor
from timelines.experiments.calm import DisturbedError
from timelines.experiments.metrics import Pair, Run, cpu_per_input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

NEAR = 0.06
"""How far the work for the same inputs may be from the calibration's where a run shows what a whole processor is: how
much the tasks wait for memory depends on their own speed."""
ENOUGH = 3
"""Runs that show it: a single one is off by up to 3 %."""
TRIES = 6


def this_machine() -> dict[str, Any]:
    """What it says of itself."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory, 1),
        "kernel": platform.release(),
    }


def kind(machine: Mapping[str, Any]) -> str:
    """Machines that are alike; a virtual one has the kernel of its host's generation, which its processor hides."""
    return "{processor}, {cores} cores, {kernel}".format(**machine)


def whole_here(reference: Run, known: Iterable[Run], play: Callable[[float], Run]) -> float:
    """As many turns a second of the loop as make the tasks' work for the same inputs the calibration's.

    `reference` is the calibration's run of each task alone, `known` are repetitions of it on this machine, and `play`
    makes another one, with what counts as a whole processor. It is the median of what they show, so that it stays the
    same once there are ENOUGH. DisturbedError if they differ too much.
    """
    runs = list(known)
    for _ in range(TRIES):
        found = [_shown(run, reference) for run in runs if abs(_work(run, reference) - 1) <= NEAR]
        if len(found) >= ENOUGH:
            return round(median(found))
        runs.append(play(_shown(runs[-1], reference) if runs else reference.whole))
    works = ", ".join(f"{_work(run, reference):.0%}" for run in runs)
    raise DisturbedError(f"the tasks took {works} of the calibration's work: expected {ENOUGH} runs of about 100%")


def _shown(run: Run, reference: Run) -> float:
    """What a whole processor is by one run."""
    return run.whole * _work(run, reference)


def _work(run: Run, reference: Run) -> float:
    return cpu_per_input(Pair(run.schedule, run.record, reference.record))["all tasks"].value
