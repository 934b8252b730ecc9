"""What a run's raw data says. Pure.

Total execution time is the paper's: from the first input until every input that the policy did not suspend is done. The
queues are so long that they drop nothing; what a suspended task did not take is counted apart, and so is what got lost.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from timelines.experiments.raw_data import Counters, Done, RunData

SETTLED = 1e-6
"""Cores by which a limit may differ from the share that it carries out."""
WINDOW = 0.5
"""Seconds over which CPU use is averaged."""


class Fate(StrEnum):
    """What became of an input."""

    PROCESSED = "processed"
    SUSPENDED = "suspended"
    """Published while the task was suspended, or in its queue when that began: a suspended task empties its queues."""
    UNFINISHED = "unfinished"
    """Still waiting when the run was given up."""
    LOST = "lost"
    """On its way: a bus drops what a starved subscriber does not fetch."""


class Outcome(NamedTuple):
    """One input of one task; `number` counts the inputs of its key, and is the same in all runs of a timeline."""

    key: str
    number: int
    stamp: int
    fate: Fate
    done: Done | None


@dataclass(frozen=True, slots=True)
class Response:
    """Of a task's inputs that were not suspended: how many, seconds from source to result, and those past the deadline.

    `p50` and `p99` are None where nothing was done. What was lost or never done has missed its deadline.
    """

    due: int
    p50: float | None
    p99: float | None
    missed: int

    @property
    def misses(self) -> float:
        """Fraction of what was due."""
        return self.missed / self.due if self.due else 0.0


@lru_cache(maxsize=1024)
def outcomes(run: RunData, task: str) -> tuple[Outcome, ...]:
    """What became of each of a task's inputs."""
    done = {(one.input, one.stamp): one for one in run.done.get(task, ())}
    suspended = suspensions(run, task)
    found = []
    for name, key in run.inputs[task].items():
        own = sorted((one for one in run.done.get(task, ()) if one.input == name), key=lambda one: one.stamp)
        fate = _fates(run, own, suspended)
        for number, stamp in enumerate(sorted(run.published.get(key, ()))):
            match = done.get((name, stamp))
            found.append(Outcome(key, number, stamp, Fate.PROCESSED if match else fate(stamp), match))
    return tuple(found)


def _fates(run: RunData, own: Sequence[Done], suspended: Sequence[tuple[float, float]]) -> Callable[[int], Fate]:
    """Finds the fate of an input that was not processed; `own` are those that were, by stamp."""
    stamps = [one.stamp for one in own]

    def fate(stamp: int) -> Fate:
        newer = own[bisect_right(stamps, stamp) :][:1]
        done_later = newer[0].finished if newer else float("inf")  # a queue keeps the order
        if any(begin <= stamp / 1e9 < end or stamp / 1e9 < begin < done_later for begin, end in suspended):
            return Fate.SUSPENDED
        return Fate.LOST if newer or run.drained else Fate.UNFINISHED

    return fate


def suspensions(run: RunData, task: str) -> list[tuple[float, float]]:
    """When the plans suspended a task, in Unix seconds."""
    return [(begin, end) for begin, end, plan in spans(run) if plan["tasks"].get(task, {}).get("suspended")]


def spans(run: RunData) -> Iterator[tuple[float, float, dict[str, Any]]]:
    """Each plan with the time from which it held, and until when."""
    plans = sorted(run.plans, key=lambda plan: (plan.get("run", 0), plan["sequence"], plan.get("edition", 0)))
    for index, plan in enumerate(plans):
        end = began(plans[index + 1]) if index + 1 < len(plans) else float("inf")
        yield began(plan), end, plan


def began(plan: Mapping[str, Any]) -> float:
    """When the sample that led to a plan arrived; of a plan that was asked for, when it was made."""
    return float(plan.get("trigger", plan["time"]))


def total_time(run: RunData) -> float:
    """Seconds from the first input until the last one is done, at least as long as inputs come."""
    return max(_finished(run, lambda _task, _outcome: True), run.ended) - run.started


def equal_work(run: RunData, other: RunData) -> tuple[float, float]:
    """Seconds until each run was done with those inputs that both processed."""
    common = _processed(run) & _processed(other)

    def until(one: RunData) -> float:
        finished = _finished(one, lambda task, outcome: (task, outcome.key, outcome.number) in common)
        return max(finished - one.started, 0.0)

    return until(run), until(other)


def _processed(run: RunData) -> set[tuple[str, str, int]]:
    return {(task, one.key, one.number) for task in run.inputs for one in outcomes(run, task) if one.done}


def _finished(run: RunData, counts: Callable[[str, Outcome], bool]) -> float:
    return max(
        (
            one.done.finished
            for task in run.inputs
            for one in outcomes(run, task)
            if one.done is not None and counts(task, one)
        ),
        default=run.started,
    )


def task_time(run: RunData, task: str) -> float | None:
    """Seconds from the first input until a task was done with its last one; None if it did nothing."""
    finished = [one.done.finished for one in outcomes(run, task) if one.done is not None]
    return max(finished) - run.started if finished else None


def over_ideal(ideal: RunData, run: RunData, task: str, *, moving: bool | None = None) -> float | None:
    """Median response time of a task as a multiple of what the same inputs take when nothing else runs."""
    alone = {(one.key, one.number): _response(one) for one in outcomes(ideal, task) if one.done}
    pairs = [
        (_response(one), alone[one.key, one.number])
        for one in outcomes(run, task)
        if one.done and (one.key, one.number) in alone and (moving is None or is_moving(run, one.stamp / 1e9) is moving)
    ]
    return median(mine for mine, _ in pairs) / median(its for _, its in pairs) if pairs else None


def _response(outcome: Outcome) -> float:
    return outcome.done.finished - outcome.stamp / 1e9 if outcome.done else float("inf")


def responses(run: RunData, task: str, *, moving: bool | None = None) -> list[float]:
    """Response times of a task, ascending."""
    due = (one for one in outcomes(run, task) if one.done)
    return sorted(_response(one) for one in due if moving is None or is_moving(run, one.stamp / 1e9) is moving)


def counts(run: RunData, task: str) -> dict[Fate, int]:
    """How many inputs of a task had which fate."""
    found = [one.fate for one in outcomes(run, task)]
    return {fate: found.count(fate) for fate in Fate}


def response(run: RunData, task: str, *, moving: bool | None = None) -> Response:
    """How fast a task was, on the inputs from when the robot moves, from when it stands, or on all."""
    due = [one for one in outcomes(run, task) if one.fate is not Fate.SUSPENDED]
    if moving is not None:
        due = [one for one in due if is_moving(run, one.stamp / 1e9) is moving]
    times = sorted(_response(one) for one in due if one.done)
    deadline = run.deadlines.get(task)
    late = sum(time > deadline for time in times) if deadline else 0
    return Response(len(due), quantile(times, 0.5), quantile(times, 0.99), late + len(due) - len(times))


def is_moving(run: RunData, moment: float) -> bool:
    """Whether the robot moves at a moment, by the story's truth."""
    at = run.story_time(moment)
    return any(stretch.moving for stretch in run.stretches if stretch.start <= at < stretch.end)


def quantile(ordered: Sequence[float], part: float) -> float | None:
    """The value that `part` of the ordered values do not exceed; None without values."""
    return ordered[min(int(part * len(ordered)), len(ordered) - 1)] if ordered else None


def cores_used(run: RunData, task: str) -> list[tuple[float, float]]:
    """Cores that a task used, averaged over half a second, as steps of (seconds since the begin, cores)."""
    kept: list[Counters] = []
    for counted in run.counters.get(task, ()):
        if counted.at >= run.started and (not kept or counted.at - kept[-1].at >= WINDOW):
            kept.append(counted)
    return [(a.at - run.started, (b.usage - a.usage) / (b.at - a.at)) for a, b in pairwise(kept)]


def cpu_seconds(run: RunData, task: str) -> float:
    """CPU that a task used from the first input on."""
    own = [counted for counted in run.counters.get(task, ()) if counted.at >= run.started]
    return own[-1].usage - own[0].usage if own else 0.0


def cpu_of_others(run: RunData, known: Sequence[str]) -> float | None:
    """CPU seconds of all but the known containers: of Kubernetes, of what plays and records, and of strangers."""
    busy = run.about.get("busy")
    return None if busy is None else busy - sum(cpu_seconds(run, name) for name in known)


def contexts(run: RunData) -> list[tuple[str, float, float]]:
    """When each context held, in seconds since the begin."""
    found: list[tuple[str, float, float]] = []
    last = total_time(run)
    for begin, end, plan in spans(run):
        start, stop = max(begin - run.started, 0.0), min(end - run.started, last)
        for name in plan["contexts"] if stop > start else ():
            before = next((i for i, one in enumerate(found) if one[0] == name and one[2] >= start - SETTLED), None)
            if before is None:
                found.append((str(name), start, stop))
            else:
                found[before] = (str(name), found[before][1], stop)
    return found


def reactions(run: RunData) -> list[float]:
    """Seconds from each sample that moved shares until the kernel had all of the new limits.

    Limits are read ten times a second, so each is up to 0.1 s too long. Plans that a newer one overtook are left out.
    """
    found = []
    for (_, _, old), (begin, end, plan) in pairwise(spans(run)):
        moved = [task for task in plan["tasks"] if _share(plan, task) != _share(old, task)]
        reached = [_reached(run, task, _share(plan, task), begin, end) for task in moved]
        if begin >= run.started and reached and None not in reached:
            found.append(max(at for at in reached if at is not None) - begin)
    return found


def _share(plan: Mapping[str, Any], task: str) -> float:
    return float(plan["tasks"].get(task, {}).get("share", 0.0))


def _reached(run: RunData, task: str, share: float, begin: float, end: float) -> float | None:
    return next(
        (
            counted.at
            for counted in run.counters.get(task, ())
            if begin <= counted.at <= end and counted.limit is not None and abs(counted.limit - share) < SETTLED
        ),
        None,
    )
