"""Figures over blocks, for tables and pictures. Pure."""

from __future__ import annotations

import math
from statistics import fmean, median
from typing import TYPE_CHECKING

from timelines.experiments.accounting import Ending, Tally
from timelines.experiments.cpu_account import MACHINE
from timelines.experiments.due import TENTHS
from timelines.experiments.metrics import Pair, contexts, cpu_per_input
from timelines.experiments.paired import bootstrap

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from timelines.experiments.due import Schedule
    from timelines.experiments.metrics import Run
    from timelines.experiments.paired import Interval

CONTROL = ("operator", "router", "agent")
"""Containers of what decides and carries it out; the router is the bus, which a robot has anyway."""


def by_context(schedules: Iterable[Schedule]) -> dict[str, str]:
    """The contexts of some stories with the task that each is about."""
    return {context: task for schedule in schedules for context, task in contexts(schedule).items()}


def critical(runs: Sequence[Run], context: str, task: str) -> Interval | None:
    """The critical task's hit rate in a context."""
    return _by_block([run for run in runs if context in contexts(run.schedule)], task, context)


def whole(runs: Sequence[Run], task: str) -> Interval | None:
    """A task's hit rate over whole stories."""
    return _by_block([run for run in runs if task in run.schedule.inputs], task)


def _by_block(runs: Sequence[Run], task: str, context: str | None = None) -> Interval | None:
    """A hit rate over blocks: what was due in all stories of a block is one value. None where nothing was."""
    tallies: dict[int, list[Tally]] = {}
    for run in runs:
        tallies.setdefault(run.record.block, []).append(run.tally(task, context))
    values = [_pooled(own) for own in tallies.values() if any(one.due for one in own)]
    return bootstrap(values) if values else None


def _pooled(tallies: Sequence[Tally]) -> float:
    """The hit rate over what was due in several runs."""
    due = sum(one.due for one in tallies)
    return sum(one.count(Ending.IN_TIME) for one in tallies) / due if due else math.nan


def worst_context(runs: Sequence[Run]) -> Interval | None:
    """The least hit rate of a critical task in a context, over blocks, whose stories are pooled."""
    about = by_context(run.schedule for run in runs)
    blocks = {run.record.block: [one for one in runs if one.record.block == run.record.block] for run in runs}
    rates = {block: [critical(own, context, task) for context, task in about.items()] for block, own in blocks.items()}
    values = [min(one.mean for one in own if one) for own in rates.values() if any(own)]
    return bootstrap(values) if values else None


def endings(runs: Sequence[Run], task: str) -> Mapping[Ending, float]:
    """How all of a task's inputs ended, on average over runs, also those that no context wants."""
    tallies = [Tally.of(one.ending for one in run.ended(task)) for run in runs]
    return {ending: fmean(tally.count(ending) for tally in tallies) for ending in Ending}


def onset(runs: Sequence[Run], context: str, task: str) -> tuple[float, float] | None:
    """The critical task's hit rate at the context's onset, and after it: what was due in all runs is one value."""
    own = [run for run in runs if context in contexts(run.schedule)]
    early, later = ([run.tally(task, context, onset=part) for run in own] for part in (True, False))
    return (_pooled(early), _pooled(later)) if own else None


def right(runs: Sequence[Run], task: str) -> Interval | None:
    """How right a task was, over blocks: what was judged in all stories of a block is one value. None without any."""
    found: dict[int, list[tuple[float, float]]] = {}
    for run in runs:
        if task in run.record.accuracy:
            _, value, unit, count, *_ = run.record.accuracy[task]
            found.setdefault(run.record.block, []).append((value, count if unit == "%" else 1))
    means = [fmean(values, counts) for values, counts in (zip(*own, strict=True) for own in found.values())]
    return bootstrap(means) if means else None


def covered(runs: Sequence[Run], task: str) -> Interval | None:
    """The part of what is wanted of a task that came to something (see `Run.covered`), over blocks."""
    found: dict[int, list[tuple[float, float]]] = {}
    for run in runs:
        if task in run.schedule.inputs and (due := run.tally(task).due):
            found.setdefault(run.record.block, []).append((run.covered(task), due))
    means = [fmean(values, counts) for values, counts in (zip(*own, strict=True) for own in found.values())]
    return bootstrap(means) if means else None


def work_of_same(runs: Sequence[Run], others: Sequence[Run]) -> float | None:
    """The work that inputs took which runs of the same story both did, as a part of the others'. None without any."""
    pairs = [
        Pair(run.schedule, run.record, other.record)
        for run in runs
        for other in others
        if run.record.story == other.record.story
    ]
    found = [case.value for pair in pairs for case in cpu_per_input(pair).values()]
    return median(found) if found else None


def used(runs: Sequence[Run], containers: Iterable[str]) -> float:
    """Cores that containers used while inputs came, the median over runs."""
    names = list(containers)
    return median(math.fsum(_cores(run, name) for name in names) for run in runs)


def exhausted(runs: Sequence[Run], tasks: Iterable[str]) -> float:
    """The part that the tasks used of the CPU that what slows the processors leaves them, the median over runs."""
    names = list(tasks)
    return median(math.fsum(_cores(run, name) for name in names) / _left(run) for run in runs)


def _left(run: Run) -> float:
    """Cores that the tasks could have had."""
    processors, part = run.record.about["capacity"]
    return float(processors * part * run.record.about["pace"]["left"]) / run.speed


def _cores(run: Run, container: str) -> float:
    """While inputs came: how long its queues take to empty afterwards differs among configurations."""
    spent = run.record.used.get(container, ())[: math.floor(run.schedule.duration) + 1]
    return spent[-1] / 1000 / (len(spent) - 1) if len(spent) > 1 else 0.0


def used_by_all_else(runs: Sequence[Run]) -> float:
    """Cores that Kubernetes used, what plays and records, and strangers, until all queues were empty.

    Not what slows the processors.
    """
    return median(_else(run.record.about["cpu"]) / float(run.record.about["seconds"]) for run in runs)


def _else(spent: Mapping[str, float]) -> float:
    return spent[MACHINE] - sum(seconds for name, seconds in spent.items() if name != MACHINE)


def lateness(runs: Sequence[Run]) -> tuple[float, float]:
    """How late the player was itself, in milliseconds: of all inputs the median, and within which 99 % were."""
    every = sorted(late for run in runs for own in run.record.late.values() for late in own)
    return (every[len(every) // 2] / 10, every[len(every) * 99 // 100] / 10) if every else (0.0, 0.0)


def commands(runs: Sequence[Run], context: str) -> float:
    """Wheel commands as a part of the frames due in a context."""
    found = [run.commands(context) for run in runs]
    due = sum(one for one, _ in found)
    return sum(len(times) for _, times in found) / due if due else 0.0


def command_latency(runs: Sequence[Run], context: str, part: float) -> Interval | None:
    """Seconds from a frame to its wheel command that a part of those in a context took at most, over blocks."""
    return _over_blocks(((run, run.commands(context)[1]) for run in runs), part)


def stops(runs: Sequence[Run], context: str) -> tuple[int, int]:
    """How many "stop" were said in a context, and how many led to an order."""
    said = sum(len(_said(run, context)) for run in runs)
    return said, sum(len(_stopped(run, context)) for run in runs)


def stop_latency(runs: Sequence[Run], context: str) -> Interval | None:
    """The median of the seconds from the end of a "stop" to its order, over blocks."""
    return _over_blocks(((run, _stopped(run, context)) for run in runs), 0.5)


def _said(run: Run, context: str) -> set[int]:
    """The numbers of the "stop" that begin in a context."""
    windows = [one for one in run.schedule.windows if one.name == context]
    stops = enumerate(run.schedule.stops)
    return {number for number, (begin, _) in stops if any(one.begin <= begin < one.end for one in windows)}


def _stopped(run: Run, context: str) -> list[float]:
    """Seconds from the end of each of these until its order, where it led to one."""
    numbers = _said(run, context)
    return [late / TENTHS for number, late in run.record.stops if number in numbers]


def _over_blocks(found: Iterable[tuple[Run, Sequence[float]]], part: float) -> Interval | None:
    """What a part of each block's values is at most. None without any."""
    blocks: dict[int, list[float]] = {}
    for run, own in found:
        blocks.setdefault(run.record.block, []).extend(own)
    values = [_quantile(sorted(own), part) for own in blocks.values() if own]
    return bootstrap(values) if values else None


def _quantile(ascending: Sequence[float], part: float) -> float:
    """The median is between the two in the middle: of few values it would else be the slower one."""
    return median(ascending) if part == 0.5 else ascending[math.floor(part * len(ascending))]


def responses(runs: Sequence[Run], context: str, task: str) -> tuple[list[float], int]:
    """Response times of the critical task in a context, ascending, and how many inputs were due."""
    ended = [one for run in runs for one in run.wanted(task, context)]
    return sorted(one.response for one in ended if one.response is not None), len(ended)
