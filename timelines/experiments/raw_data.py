"""A run's recording as values: what was published, what each task did with it, what was decided and what it used."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.policy.quantities import parse_duration
from contextpolicy.streams.recordings import Excerpt, open_recording
from contextpolicy.streams.timeline import load
from timelines.experiments.run import MESSAGES, RUN, TIMELINE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Recorded


class Done(NamedTuple):
    """An input that a task has done: when it was published, taken and done (Unix seconds), and the CPU (seconds)."""

    input: str
    stamp: int
    started: float
    finished: float
    cpu: float


class Result(NamedTuple):
    """What a task published: when it was true by its own stamp, when it was heard (Unix seconds), and the message."""

    at: float
    heard: float
    value: Mapping[str, Any]


class Counters(NamedTuple):
    """A container's cgroup at a moment: the limit in cores (None: no limit), CPU used and throttled, in seconds."""

    at: float
    limit: float | None
    usage: float
    throttled: float


class Stretch(NamedTuple):
    """A part of the story, in seconds since it began, and whether the robot moves in it."""

    name: str
    start: float
    end: float
    moving: bool


@dataclass(eq=False)
class RunData:
    """One run, unchanged once it is read; stamps are in ns since 1970, `started` and `ended` in Unix seconds."""

    configuration: str
    title: str
    started: float
    ended: float
    """When the inputs ended."""
    drained: bool = True
    pace: float = 1.0
    """Seconds of the story that passed in one second."""
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Of each task: the key of each input."""
    deadlines: Mapping[str, float | None] = field(default_factory=dict)
    stretches: list[Stretch] = field(default_factory=list)
    published: Mapping[str, list[int]] = field(default_factory=dict)
    """Of each key: the stamps that the player gave."""
    done: dict[str, list[Done]] = field(default_factory=lambda: defaultdict(list))
    results: dict[str, list[Result]] = field(default_factory=lambda: defaultdict(list))
    """Of each key that a task publishes on, in the order in which they were heard."""
    plans: list[dict[str, Any]] = field(default_factory=list)
    counters: dict[str, list[Counters]] = field(default_factory=lambda: defaultdict(list))
    about: dict[str, Any] = field(default_factory=dict)

    def story_time(self, moment: float) -> float:
        """Seconds of the story at a moment (Unix seconds)."""
        return (moment - self.started) * self.pace


def read_run(folder: Path) -> RunData:
    """Read a finished run; RecordingError if its recording can't be read."""
    about = json.loads((folder / RUN).read_text(encoding="utf-8"))
    player = about["player"]
    run = RunData(about["configuration"], about["title"], player["started"], player["finished"], about["drained"])
    run.about, run.inputs, run.published = about, about["inputs"], about["stamps"]
    run.pace = about.get("pace", 1.0)
    run.deadlines = {task: None if text is None else parse_duration(text) for task, text in about["deadlines"].items()}
    run.stretches = [
        Stretch(phase.name, phase.start, phase.end, _moving(phase.truth)) for phase in load(folder / TIMELINE).phases
    ]
    recording = open_recording(folder / MESSAGES, Excerpt())
    for message in recording.messages(recording.topics, recording.begin, recording.end):
        _take(run, message)
    return run


def _moving(truth: object) -> bool:
    return isinstance(truth, dict) and bool(truth.get("moving"))


def _take(run: RunData, message: Recorded) -> None:
    parts = message.topic.split("/")
    if parts[0] == "robot" and parts[-1] == "runs":
        run.done[parts[1]] += map(_done, json.loads(message.payload))
    elif (
        parts[0] == "robot" and parts[1] in run.inputs and parts[-1] not in _OWN and message.topic not in run.published
    ):
        run.results[message.topic].append(_result(message))
    elif parts[0] == "cgroup":
        run.counters[parts[1]].append(_counters(message.at / 1e9, json.loads(message.payload)))
    elif parts[0] == "contextpolicy" and parts[-1] == "plan" and message.payload:
        run.plans.append(json.loads(message.payload))


_OWN = ("health", "alive", "profile")
"""What robotkit reports of a task, beside its results."""


def _result(message: Recorded) -> Result:
    value = json.loads(message.payload)
    return Result(value.get("stamp", message.at) / 1e9, message.at / 1e9, value)


def _done(timing: Mapping[str, Any]) -> Done:
    started, finished = timing["started"] / 1e9, timing["finished"] / 1e9
    return Done(timing["input"], timing["stamp"], started, finished, timing["cpu"] / 1e9)


def _counters(at: float, value: Mapping[str, Any]) -> Counters:
    return Counters(at, value["limit"], value["usage"], value.get("throttledTime", 0.0))
