"""What a run's recording comes to, in the few numbers that are kept. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING, Any

from timelines.demo.deploy import DeployError
from timelines.experiments.accounting import Heard
from timelines.experiments.accuracy import EARLY, LATE
from timelines.experiments.due import TENTHS
from timelines.experiments.executive import KEYWORD, POSE
from timelines.experiments.record import Column, Record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from timelines.experiments.accounting import Timing
    from timelines.experiments.accuracy import Accuracy
    from timelines.experiments.blocks import Trial
    from timelines.experiments.due import Schedule
    from timelines.experiments.raw_data import RunData

FRAMES = "robot/camera/stereo"
TRUSTED = ("tracking", "degraded")
"""States in which SLAM knows a pose (modules/slam/slam.py)."""
HEEDED = 0.5
"""Seconds after which a suspended module has received the plan, and finished the input that it was working on."""
FEW = 10
"""Inputs that are too few to judge by which part of them was done."""


def record(trial: Trial, run: RunData, schedule: Schedule, judged: Mapping[str, Accuracy]) -> Record:
    """The record of a run.

    DeployError if not all that was due was published. What the policy or the modules did wrong is kept with it.
    """
    for key in _taken(schedule):
        published, due = len(run.published.get(key, ())), len(schedule.keys[key])
        if published != due:
            raise DeployError(f"{trial}: {published} inputs on {key}: expected {due}")
    return Record(
        load=trial.load,
        story=trial.story.name,
        configuration=trial.configuration.name,
        block=trial.block,
        columns={
            task: {name: _column(run, schedule, task, name) for name in own} for task, own in schedule.inputs.items()
        },
        late=_lateness(run, schedule),
        about={
            **run.about["about"],
            "finished": _finished(run),
            "unheard": dict(_unheard(run, schedule)),
            "violations": [*_violations(trial, run, schedule)],
        },
        plans=_plans(run),
        used={name: _used(run, name) for name in sorted(run.counters)},
        commands=list(_commands(run)),
        stops=list(_stops(run, schedule)),
        accuracy={task: _plain(one) for task, one in judged.items()},
        trusted=_trusted(run),
    )


def _violations(trial: Trial, run: RunData, schedule: Schedule) -> Iterator[str]:
    """Where gating or contexts had no effect."""
    if trial.configuration.gated or trial.configuration.contextual:
        due = {name for window in schedule.windows for name in window.contexts}
        yield from (f"no plan had {name}" for name in sorted(due - _planned(run)))
    for task, own in schedule.inputs.items():
        away = [(begin + HEEDED, end) for begin, end in run.away(task)]
        for name, key in own.items():
            inside = [one for one in run.published.get(key, ()) if any(a <= one / 1e9 < b for a, b in away)]
            done = sum(one in run.done[task, name] for one in inside)
            if len(inside) >= FEW and 2 * done > len(inside):
                yield f"{task} did {done} of {len(inside)} inputs while it was suspended"


def _planned(run: RunData) -> set[str]:
    """The contexts that the policy saw."""
    return {name for plan in run.plans for name in plan["contexts"]}


def _unheard(run: RunData, schedule: Schedule) -> Iterator[tuple[str, int]]:
    """Inputs that a task has done and the recording lacks, by task and input: they would count as lost."""
    for task, own in schedule.inputs.items() if run.about["about"]["drained"] else ():
        for name in own:
            missing = run.counted.get(task, {}).get(name, 0) - len(run.done[task, name])
            if missing > 0:
                yield f"{task}/{name}", missing


def _column(run: RunData, schedule: Schedule, task: str, name: str) -> Column:
    stamps = run.published.get(schedule.inputs[task][name], [])
    dropped = run.dropped.get(task, {}).get(name, 0)
    return Column.of(Heard(stamps, run.done[task, name], run.away(task), dropped).endings())


def _lateness(run: RunData, schedule: Schedule) -> dict[str, list[int]]:
    """How much later than due each input was published, in tenths of a millisecond; of what some task takes."""
    return {
        key: [
            round((stamp / 1e9 - run.starts[key] - at) * TENTHS)
            for stamp, at in zip(run.published[key], schedule.keys[key], strict=True)
        ]
        for key in _taken(schedule)
    }


def _taken(schedule: Schedule) -> list[str]:
    """The keys that some task takes."""
    return sorted({key for own in schedule.inputs.values() for key in own.values()})


def _trusted(run: RunData) -> str:
    """A letter for each frame: 1 if a pose that SLAM trusts came of it, else 0."""
    poses = {int(one.value["stamp"]) for one in run.results.get(POSE, ()) if one.value.get("state") in TRUSTED}
    return "".join("1" if stamp in poses else "0" for stamp in run.published.get(FRAMES, ()))


def _finished(run: RunData) -> float:
    """Seconds from the first input until the last one was done."""
    ends = [timing.finished for timings in run.done.values() for timing in timings.values()]
    return round(max(ends, default=run.started) - run.started, 3)


def _plans(run: RunData) -> list[list[Any]]:
    """What was decided, from what held when the inputs began; plans that a newer one overtook at once are left out."""
    kept = []
    for begin, end, plan in run.spans():
        if end > max(begin, run.started):
            tasks = {name: [one["weight"], round(one["share"] * 1000)] for name, one in plan["tasks"].items()}
            kept.append([round(max(begin - run.started, 0.0) * 1000), plan["contexts"], tasks])
    return kept


def _used(run: RunData, container: str) -> list[int]:
    """CPU that a container has used since the first input, in milliseconds, once a second."""
    own = [counted for counted in run.counters[container] if counted.at >= run.started]
    if not own:
        return []
    moments = [counted.at for counted in own]
    ticks = range(math.floor(moments[-1] - run.started) + 1)
    places = (min(bisect_left(moments, run.started + tick), len(own) - 1) for tick in ticks)
    return [round((own[place].usage - own[0].usage) * 1000) for place in places]


def _commands(run: RunData) -> Iterator[list[int]]:
    """Each frame that led to a wheel command: its number, and how long that took."""
    numbers = {stamp: number for number, stamp in enumerate(run.published.get(FRAMES, ()))}
    for order in run.orders:
        done = _carried_out(run, order.stamp)
        if order.cause == POSE and done and order.source in numbers:
            yield [numbers[order.source], round((done.finished - order.source / 1e9) * TENTHS)]


def _stops(run: RunData, schedule: Schedule) -> Iterator[list[int]]:
    """Each spoken "stop" that stopped the wheels: its number, and how long after its end; the first answer counts."""
    answered: set[int] = set()
    for order in run.orders:
        done, at = _carried_out(run, order.stamp), order.source / 1e9 - run.started
        said = [n for n, (begin, end) in enumerate(schedule.stops) if begin - EARLY <= at <= end + LATE]
        fresh = [number for number in said if number not in answered]
        if order.cause == KEYWORD and done and fresh:
            answered.add(fresh[0])
            yield [fresh[0], round((done.finished - run.started - schedule.stops[fresh[0]][1]) * TENTHS)]


def _carried_out(run: RunData, stamp: int) -> Timing | None:
    """What navigation did with an order: its wheel command is out when it is done with it."""
    return run.done["navigation", "order"].get(stamp)


def _plain(one: Accuracy) -> list[Any]:
    return [one.measure, round(one.value, 4), one.unit, one.count, one.more_is_better]
