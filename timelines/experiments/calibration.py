"""How much the tasks have to share, and which deadlines are fair, from each task alone, before any comparison. Pure.

A load is what the tasks want, as a part of what there is. A task that fails alone has a deadline that this machine
can't keep, which is no question of scheduling.
"""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import fmean, median
from typing import TYPE_CHECKING

from timelines.experiments.blocks import HEAVY, LIGHT, PAPERS_LOAD, SWEEP
from timelines.experiments.capacity import Capacity, beside
from timelines.experiments.metrics import contexts
from timelines.experiments.stories import PROTECTED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from timelines.experiments.accounting import Ended
    from timelines.experiments.metrics import Run

LOADS: Mapping[str, float] = {LIGHT: 0.7, HEAVY: 1.4, PAPERS_LOAD: 1.4, **{load: float(load) for load in SWEEP}}
"""What the tasks together want, as a part of what there is."""
SLOWEST = 0.15
"""Part of a processor that is left at least: the kernel stops realtime threads that take more than 95 %."""
FASTEST = 1.25
"""Whole processors that one is asked to do at most. Where limits left them idle those of the first blocks' machine did
1.45 at times, of which what slows them needs a twentieth: at 1.39 four runs in a row had less than their pace."""
ROOM = 0.85
"""Part of the capacity that a context's critical and protected tasks may want at most. If they want more than there is,
no division can keep a goal, and nothing is learned from a miss. Beside others an input takes more CPU than alone."""
NEARLY_ALL = 0.9
"""Part of a context's stretches of two seconds that want no more than what counts as its need. Two seconds, since a
picture of signs takes a third of one, and not all cost the same."""
SLIGHT = 0.1
"""Part of a processor that is not worth another one: each of two would be half as fast."""
FAIR = 0.99
"""What a task has to hit alone for its deadline to be fair: of the two points that a goal forgives, one at most is what
is hard for it even alone."""
SPARE = 0.5
"""Part of its deadline within which it has to: what it just keeps alone, nobody keeps beside others."""
LONGER = 2
"""How often a deadline may be doubled; a task that needs more is not able to do this story on this machine."""


def demand(runs: Sequence[Run]) -> dict[str, float]:
    """Whole processors that each task wants while its inputs come, from runs in which each was alone."""
    return {task: sum(_wanted(run, task) for run in runs) / len(runs) for task in runs[0].schedule.inputs}


def _wanted(run: Run, task: str) -> float:
    """Those while its inputs came: less what it used at rest while the others' came, plus what it did not get to."""
    length, about, ended = run.schedule.duration, run.record.about, run.ended(task)
    done = [one.cpu for one in ended if one.cpu is not None]
    left_out = math.fsum(done) * (len(ended) / len(done) - 1) if done else 0.0
    own: float = about["cpu"][task] - _resting(run.record.used[task]) * (about["seconds"] - length)
    return (own + left_out) * run.speed / length


def _resting(used: Sequence[int]) -> float:
    """Cores of a task for which no inputs come, as in most of the seconds of such a run."""
    return median(after - before for before, after in pairwise(used)) / 1000


def neediest(runs: Sequence[Run]) -> dict[str, float]:
    """Whole processors that each context's critical and protected tasks want together, nearly all of its time."""
    found: dict[str, list[float]] = {}
    for run in runs:
        wanted, about = {task: _by_second(run, task) for task in run.schedule.inputs}, contexts(run.schedule)
        for window in run.schedule.windows:
            if window.name not in about:
                continue
            own = [wanted[task] for task in {about[window.name], *PROTECTED} if task in wanted]
            for at in range(math.ceil(window.begin), math.floor(window.end) - 1):
                both = fmean(math.fsum(task[second] for task in own) for second in (at, at + 1))
                found.setdefault(window.name, []).append(both)
    return {context: sorted(every)[math.ceil(NEARLY_ALL * len(every)) - 1] for context, every in found.items()}


def _by_second(run: Run, task: str) -> list[float]:
    """What a task wants in each second of the story: for the inputs that come in it, and for all else it does."""
    ended = run.ended(task)
    beside = _wanted(run, task) - run.speed * math.fsum(one.cpu or 0.0 for one in ended) / run.schedule.duration
    found = [beside] * math.ceil(run.schedule.duration)
    for due, end in zip(run.schedule.of(task), ended, strict=True):
        found[math.floor(due.at)] += run.speed * (end.cpu or 0.0)
    return found


def of_load(load: str, runs: Sequence[Run], cores: int) -> Capacity:
    """What makes a load of the tasks of these runs, in which each was alone."""
    return capacity(load, demand(runs), cores, max(neediest(runs).values()))


def asked(runs: Sequence[Run], there: Capacity, cores: int) -> float:
    """What all tasks want, and what runs beside them on the same processors, as a part of what there is."""
    others = beside(there.processors, cores) / 1000
    return round((sum(demand(runs).values()) + others) / (there.processors * there.part), 2)


def capacity(load: str, wanted: Mapping[str, float], cores: int, least: float = 0.0) -> Capacity:
    """What makes a load: the fewest processors that are enough, slowed as far as it takes.

    It has room for `least`, what the neediest context's tasks want. Where there are no others all else runs on them,
    too. A part of more than 1 needs processors that are faster than a whole one, of which there are.
    """
    needed = max(sum(wanted.values()) / LOADS[load], least / ROOM)
    processors = min(max(math.ceil(needed - SLIGHT), 1), cores)
    others = beside(processors, cores) / 1000
    needed = max((sum(wanted.values()) + others) / LOADS[load], least / ROOM + others)
    return Capacity(processors, round(min(FASTEST, max(SLOWEST, needed / processors)), 3))


def swept(load: str, heavy: Capacity, asked: float) -> Capacity:
    """As many processors as under heavy load, of which the tasks want so much, slowed less or more."""
    return Capacity(heavy.processors, round(heavy.part * asked / LOADS[load], 3))


def deadline(own: float, ended: Sequence[Ended]) -> float:
    """The task's own deadline, in seconds, doubled until what it does alone has time to spare, LONGER times at most."""
    done = [one for one in ended if one.response is not None]
    for _ in range(LONGER if done else 0):
        if solo(SPARE * own, done) >= FAIR:
            break
        own *= 2
    return own


def solo(own: float, ended: Sequence[Ended]) -> float:
    """The part of what was due that was done within a deadline."""
    return sum(one.response is not None and one.response <= own for one in ended) / len(ended) if ended else math.nan
