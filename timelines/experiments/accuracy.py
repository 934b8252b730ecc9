"""How right each task was: its results against the timeline's truth. Pure, but for the poses' ground truth on disk.

Commands and signs count where the policy allowed the task to work: a policy that suspends speech while the robot moves
means not to hear what is said then. Times are the story's: at twice the pace a second of the run is two of them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from statistics import mean
from typing import TYPE_CHECKING, Any

from contextpolicy.streams.timeline import load
from robotkit.accuracy import Event, match_events
from timelines.experiments import measures
from timelines.experiments.run import TIMELINE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.raw_data import RunData

EARLY, LATE = 0.5, 2.5
"""Seconds of the story by which a command may be reported before it begins, and after."""
LINGERS = 4.0
"""Seconds for which a sign that was not read surely may still be reported when it is gone."""
FEWEST_POSES = 10


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How right a task was: `value` in `unit`, of `count` things that were judged."""

    measure: str
    value: float
    unit: str
    count: int
    more_is_better: bool = True


def accuracy(run: RunData, folder: Path, datasets: Path) -> dict[str, Accuracy]:
    """Of each task that published anything that can be judged; `folder` has the run's timeline."""
    story = load(folder / TIMELINE)
    judged = {task: judge(run, story, datasets) for task, judge in _JUDGES.items() if task in run.inputs}
    return {task: found for task, found in judged.items() if found is not None}


def _poses(run: RunData, story: Timeline, datasets: Path) -> Accuracy | None:
    """ATE of the poses that SLAM trusts."""
    from modules.slam.estimates import Estimate  # noqa: PLC0415 - OpenCV and GTSAM load slowly
    from modules.slam.evaluation import evaluate  # noqa: PLC0415
    from modules.slam.trajectory import load as load_trajectory  # noqa: PLC0415

    estimate = Estimate()
    for result in run.results.get("robot/slam/pose", ()):
        estimate.hear(json.dumps(result.value).encode())
    truth = next((one["poses"] for _, one in _truths(story, "robot/camera/stereo") if "poses" in one), "")
    sequence = datasets / truth.partition("/")[0]
    if len(estimate.poses) < FEWEST_POSES or not truth or not (datasets / truth).is_dir():
        return None
    report: Any = evaluate(estimate.trajectory, load_trajectory(sequence))
    return Accuracy("ATE", report["ate"]["rmse"], "m", report["compared"], more_is_better=False)


def _signs(run: RunData, story: Timeline, _: Path) -> Accuracy | None:
    """How many signs were reported, of those that came into view."""
    reported = [(one.at, str(one.value.get("text"))) for one in run.results.get("robot/signs/number", ())]
    truth = [
        (float(sign["from"]), float(sign["to"]), str(sign["text"]))
        for _, one in _truths(story, "robot/camera/side")
        for sign in one.get("signs", ())
    ]
    return _found(run, "signs", "signs read", reported, truth, late=LINGERS)


def _commands(run: RunData, story: Timeline, _: Path) -> Accuracy | None:
    """How many commands were heard, of those that were said."""
    reported = [
        (float(one.value["at"]), str(one.value["keyword"])) for one in run.results.get("robot/speech/keyword", ())
    ]
    truth = [
        (float(word["at"]), float(word["at"]) + 1.0, str(word["keyword"]))
        for _, words in _truths(story, "robot/microphone")
        for word in words
    ]
    return _found(run, "speech", "commands heard", reported, truth, late=LATE)


def _found(  # noqa: PLR0913, PLR0917 - what is compared
    run: RunData,
    task: str,
    measure: str,
    reported: Iterable[tuple[float, str]],
    truth: Iterable[tuple[float, float, str]],
    late: float,
) -> Accuracy | None:
    """Each true event that the policy allowed the task to see, by label; `reported` are Unix seconds."""
    heard = [Event(run.story_time(at), label) for at, label in reported]
    away = [(run.story_time(begin), run.story_time(end)) for begin, end in measures.suspensions(run, task)]
    due = [(begin, end, label) for begin, end, label in truth if not any(a < end and begin < b for a, b in away)]
    found = 0
    for begin, end, label in due:
        own = [event for event in heard if event.label == label]
        found += match_events([Event(begin, label)], own, early=EARLY, late=end - begin + late).found
    return Accuracy(measure, 100 * found / len(due), "%", len(due)) if due else None


def _motion(run: RunData, story: Timeline, _: Path) -> Accuracy | None:
    """How often it was right about whether the robot moves."""
    spans = [span for _, one in _truths(story, "robot/imu/raw") for span in one.get("moving", ())]
    right = [
        bool(one.value["moving"]) is any(begin <= run.story_time(one.at) < end for begin, end in spans)
        for one in run.results.get("robot/imu/motion", ())
        if "moving" in one.value
    ]
    return Accuracy("motion recognised", 100 * mean(right), "%", len(right)) if right else None


def _path(run: RunData, story: Timeline, _: Path) -> Accuracy | None:
    """How far the wheels went, beside how far they were ordered to go."""
    travelled = [float(one.value["travelled"]) for one in run.results.get("robot/navigation/odometry", ())]
    orders = [entry for entry in story.entries if entry.key == "robot/navigation/order"]
    ordered = sum(_speed(entry.value) * (entry.end - entry.start) for entry in orders) / run.pace
    if not travelled or not ordered:
        return None
    error = abs(travelled[-1] - travelled[0] - ordered)
    return Accuracy("path error", error, "m", len(orders), more_is_better=False)


def _speed(order: object) -> float:
    drive = order.get("drive", {}) if isinstance(order, dict) else {}
    return float(drive.get("forward", 0.0))


def _arm(run: RunData, story: Timeline, _: Path) -> Accuracy | None:
    """How many orders ended as they should, before the next one came."""
    orders = [entry for entry in story.entries if entry.key == "robot/arm/order"]
    stamps = sorted(run.published.get("robot/arm/order", ()))
    away = measures.suspensions(run, "arm")
    right = []
    for index, (entry, stamp) in enumerate(zip(orders, stamps, strict=False)):
        begin = stamp / 1e9
        end = stamps[index + 1] / 1e9 if index + 1 < len(stamps) else float("inf")
        if not any(a <= begin < b for a, b in away):
            states = (one for one in run.results.get("robot/arm/state", ()) if begin < one.heard < end)
            right.append(any(one.value.get("doing") == _doing(entry.truth) for one in states))
    return Accuracy("orders carried out", 100 * mean(right), "%", len(right)) if right else None


def _doing(truth: object) -> object:
    return truth.get("doing") if isinstance(truth, dict) else None


def _truths(story: Timeline, key: str) -> Iterator[tuple[float, Any]]:
    return ((entry.start, entry.truth) for entry in story.entries if entry.key == key and entry.truth is not None)


_JUDGES: Mapping[str, Callable[[RunData, Timeline, Path], Accuracy | None]] = {
    "slam": _poses,
    "signs": _signs,
    "speech": _commands,
    "imu": _motion,
    "navigation": _path,
    "arm": _arm,
}
