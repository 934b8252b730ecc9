"""How right each task was: its results against the timeline's truth. Pure, but for the poses' ground truth on disk.

Commands, signs and orders count where their context wants the task, by the timeline and the same in every run: what a
run did not hear because it was suspended is not heard. Commands and signs count by themselves in the contexts that are
about them as well: elsewhere others come first.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import mean
from typing import TYPE_CHECKING, Any

from robotkit.accuracy import Event, match_events
from timelines.experiments.metrics import contexts
from timelines.experiments.tasks import inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.due import Schedule
    from timelines.experiments.raw_data import RunData

EARLY, LATE = 0.5, 2.5
"""Seconds of the story by which a command may be reported before it begins, and after."""
LINGERS = 4.0
"""Seconds for which a sign that was not read surely may still be reported when it is gone."""
FEWEST_POSES = 10
APART = 1.0
"""Seconds between two orders from which on they are of two occasions to follow something."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How right a task was: `value` in `unit`, of `count` things that were judged."""

    measure: str
    value: float
    unit: str
    count: int
    more_is_better: bool = True


@dataclass(frozen=True, slots=True)
class Judge:
    """Judges runs of one story. `datasets` has the poses' ground truth."""

    story: Timeline
    schedule: Schedule
    datasets: Path

    def accuracy(self, run: RunData) -> dict[str, Accuracy]:
        """Of each task that published anything that can be judged, and of `context: task`."""
        own = {task: _from_its_begin(run, task) for task in self.schedule.inputs}
        judged = {task: judge(self, own[task]) for task, judge in _JUDGES.items() if task in own}
        for context, task in contexts(self.schedule).items():
            if task in _EVENTS:
                judged[f"{context}: {task}"] = _EVENTS[task](self, own[task], context)
        return {task: found for task, found in judged.items() if found is not None}

    def truths(self, key: str) -> Iterator[Any]:
        """What is true of a key's inputs."""
        return (entry.truth for entry in self.story.entries if entry.key == key and entry.truth is not None)

    def away(self, task: str) -> list[tuple[float, float]]:
        """When no context wants the task."""
        return [(one.begin, one.end) for one in self.schedule.windows if task in one.suspended]

    def counts(self, at: float, context: str | None) -> bool:
        """Whether a moment is in a context; any is where none is given."""
        return context is None or any(one.begin <= at < one.end for one in self.schedule.windows if one.name == context)


def _from_its_begin(run: RunData, task: str) -> RunData:
    """The run as the task saw it: where each task was played by itself, its inputs began later than the run."""
    begins = [run.starts[key] for key in inputs_of(task).values() if key in run.starts]
    return replace(run, started=begins[0]) if begins else run


def _poses(judge: Judge, run: RunData) -> Accuracy | None:
    """ATE of the poses that SLAM trusts."""
    from modules.slam.estimates import Estimate  # noqa: PLC0415 - OpenCV and GTSAM load slowly
    from modules.slam.evaluation import evaluate  # noqa: PLC0415
    from modules.slam.trajectory import TrajectoryError  # noqa: PLC0415
    from modules.slam.trajectory import load as load_trajectory  # noqa: PLC0415

    estimate = Estimate()
    for result in run.results.get("robot/slam/pose", ()):
        estimate.hear(json.dumps(result.value).encode())
    truth = next((one["poses"] for one in judge.truths("robot/camera/stereo") if "poses" in one), "")
    sequence = judge.datasets / truth.partition("/")[0]
    if len(estimate.poses) < FEWEST_POSES or not truth or not (judge.datasets / truth).is_dir():
        return None
    try:
        report: Any = evaluate(estimate.trajectory, load_trajectory(sequence))
    except TrajectoryError:  # too few are of moments that the truth has
        return None
    return Accuracy("ATE", report["ate"]["rmse"], "m", report["compared"], more_is_better=False)


def _signs(judge: Judge, run: RunData, context: str | None = None) -> Accuracy | None:
    """How many signs were reported, of those that came into view."""
    reported = [(one.at, str(one.value.get("text"))) for one in run.results.get("robot/signs/number", ())]
    truth = [
        (float(sign["from"]), float(sign["to"]), str(sign["text"]))
        for one in judge.truths("robot/camera/side")
        for sign in one.get("signs", ())
        if judge.counts(float(sign["from"]), context)
    ]
    return _found(judge, run, "signs", "signs read", reported, truth, late=LINGERS)


def _commands(judge: Judge, run: RunData, context: str | None = None) -> Accuracy | None:
    """How many commands were heard, of those that were said."""
    reported = [
        (float(one.value["at"]), str(one.value["keyword"])) for one in run.results.get("robot/speech/keyword", ())
    ]
    truth = [
        (float(word["at"]), float(word["at"]) + 1.0, str(word["keyword"]))
        for words in judge.truths("robot/microphone")
        for word in words
        if judge.counts(float(word["at"]), context)
    ]
    return _found(judge, run, "speech", "commands heard", reported, truth, late=LATE)


def _found(  # noqa: PLR0913, PLR0917 - what is compared
    judge: Judge,
    run: RunData,
    task: str,
    measure: str,
    reported: Iterable[tuple[float, str]],
    truth: Iterable[tuple[float, float, str]],
    late: float,
) -> Accuracy | None:
    """Each true event that a context wants the task to see, by label; `reported` are Unix seconds."""
    heard = [Event(at - run.started, label) for at, label in reported]
    away = judge.away(task)
    due = [(begin, end, label) for begin, end, label in truth if not any(a < end and begin < b for a, b in away)]
    found = 0
    for begin, end, label in due:
        own = [event for event in heard if event.label == label]
        found += match_events([Event(begin, label)], own, early=EARLY, late=end - begin + late).found
    return Accuracy(measure, 100 * found / len(due), "%", len(due)) if due else None


def _motion(judge: Judge, run: RunData) -> Accuracy | None:
    """How often it was right about whether the robot moves."""
    spans = [span for one in judge.truths("robot/imu/raw") for span in one.get("moving", ())]
    right = [
        bool(one.value["moving"]) is any(begin <= one.at - run.started < end for begin, end in spans)
        for one in run.results.get("robot/imu/motion", ())
        if "moving" in one.value
    ]
    return Accuracy("motion recognised", 100 * mean(right), "%", len(right)) if right else None


def _path(judge: Judge, run: RunData) -> Accuracy | None:
    """How far the wheels went, beside how far they were ordered to go."""
    travelled = [float(one.value["travelled"]) for one in run.results.get("robot/navigation/odometry", ())]
    orders = [entry for entry in judge.story.entries if entry.key == "robot/navigation/order"]
    ordered = sum(_speed(entry.value) * (entry.end - entry.start) for entry in orders)
    if not travelled or not ordered:
        return None
    error = abs(travelled[-1] - travelled[0] - ordered)
    return Accuracy("path error", error, "m", len(orders), more_is_better=False)


def _speed(order: object) -> float:
    drive = order.get("drive", {}) if isinstance(order, dict) else {}
    return float(drive.get("forward", 0.0))


def _arm(judge: Judge, run: RunData) -> Accuracy | None:
    """How many orders ended as they should, before the next one came; those to follow something never end."""
    orders = [entry for entry in judge.story.entries if entry.key == "robot/arm/order"]
    begins = [run.started + entry.start for entry in orders]
    right = []
    for entry, begin, end in zip(orders, begins, [*begins, float("inf")][1:], strict=True):
        away = any(a <= entry.start < b for a, b in judge.away("arm"))
        if not away and _doing(entry.truth) is not None:
            states = (one for one in run.results.get("robot/arm/state", ()) if begin < one.heard < end)
            right.append(any(one.value.get("doing") == _doing(entry.truth) for one in states))
    return Accuracy("orders carried out", 100 * mean(right), "%", len(right)) if right else None


def _doing(truth: object) -> object:
    return truth.get("doing") if isinstance(truth, dict) else None


def _followed(judge: Judge, run: RunData, context: str | None = None) -> Accuracy | None:
    """How far the grip was from the place that it was to be at, when the next place came."""
    orders = [one for one in judge.story.entries if one.key == "robot/arm/order" and judge.counts(one.start, context)]
    places = [(one.start, place) for one in orders if (place := _followed_place(one.value, one.truth))]
    states = [(one.heard - run.started, one.value["position"]) for one in run.results.get("robot/arm/state", ())]
    errors = []
    for (begin, place), (end, _) in pairwise(places):
        reached = next((position for at, position in reversed(states) if at < end), None)
        if reached and end - begin < APART:
            errors.append(math.dist(reached, place) / 1000)
    return Accuracy("following error", mean(errors), "m", len(errors), more_is_better=False) if errors else None


def _followed_place(order: Any, truth: object) -> Sequence[float]:
    """Where an order to follow something wants the grip, in millimetres; empty for any other."""
    follows = isinstance(truth, dict) and truth.get("follows")
    return order["move"] if follows else ()


_EVENTS: Mapping[str, Callable[[Judge, RunData, str | None], Accuracy | None]] = {
    "signs": _signs,
    "speech": _commands,
    "arm": _followed,
}
"""Of tasks whose results are single events, each of which is in one context."""
_JUDGES: Mapping[str, Callable[[Judge, RunData], Accuracy | None]] = {
    "slam": _poses,
    "signs": _signs,
    "speech": _commands,
    "imu": _motion,
    "navigation": _path,
    "arm": _arm,
}
