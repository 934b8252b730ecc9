"""A run's recording as values: what was published, what each task did with it, what was decided and what it used."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.streams.recordings import Excerpt, open_recording
from timelines.experiments.accounting import Timing
from timelines.experiments.executive import Sent

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Recorded

RUN, MESSAGES, PROFILES = "run.json", "run.mcap", "profiles.json"


class Result(NamedTuple):
    """What a task published: when it was true by its own stamp, when it was heard (Unix seconds), and the message."""

    at: float
    heard: float
    value: Mapping[str, Any]


class Counters(NamedTuple):
    """A container's CPU so far, in seconds, at a moment (Unix seconds)."""

    at: float
    usage: float


@dataclass(eq=False)
class RunData:
    """One run, unchanged once it is read; stamps are in ns since 1970, moments in Unix seconds."""

    started: float
    about: Mapping[str, Any] = field(default_factory=dict)
    starts: Mapping[str, float] = field(default_factory=dict)
    """Of each key: when the inputs began that it belongs to; not `started` where each task was played by itself."""
    published: Mapping[str, list[int]] = field(default_factory=dict)
    """Of each key: the stamps that the player gave."""
    dropped: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    """Of each task's inputs: how many it has dropped in all."""
    counted: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    """Of each task's inputs: how many it has done, by its own count."""
    orders: list[Sent] = field(default_factory=list)
    """What the executive ordered of the wheels."""
    done: dict[tuple[str, str], dict[int, Timing]] = field(default_factory=lambda: defaultdict(dict))
    """Of each task and input, by stamp."""
    results: dict[str, list[Result]] = field(default_factory=lambda: defaultdict(list))
    """Of each key that a task publishes on, in the order in which they were heard."""
    plans: list[dict[str, Any]] = field(default_factory=list)
    counters: dict[str, list[Counters]] = field(default_factory=lambda: defaultdict(list))

    def spans(self) -> Iterator[tuple[float, float, dict[str, Any]]]:
        """Each plan with the time from which it held, and until when."""
        plans = sorted(self.plans, key=lambda plan: (plan.get("run", 0), plan["sequence"], plan.get("edition", 0)))
        begins = [_began(plan) for plan in plans]
        yield from zip(begins, [*begins, float("inf")][1:], plans, strict=True)

    def away(self, task: str) -> list[tuple[float, float]]:
        """When the plans suspended a task; plans that follow each other are one stretch."""
        found: list[tuple[float, float]] = []
        for begin, end, plan in self.spans():
            if not plan["tasks"].get(task, {}).get("suspended"):
                continue
            joins = bool(found) and found[-1][1] == begin
            found.append((found.pop()[0] if joins else begin, end))
        return found


def read_run(folder: Path) -> RunData:
    """Read a finished run; RecordingError if its recording can't be read."""
    about = json.loads((folder / RUN).read_text(encoding="utf-8"))
    run = RunData(about["started"], about, about["starts"], about["stamps"], about["dropped"])
    run.counted = about["done"]
    run.orders = [Sent(*one) for one in about["orders"]]
    recording = open_recording(folder / MESSAGES, Excerpt())
    for message in recording.messages(recording.topics, recording.begin, recording.end):
        _take(run, message)
    return run


def _began(plan: Mapping[str, Any]) -> float:
    """When the sample that led to a plan arrived; of a plan that was asked for, when it was made."""
    return float(plan.get("trigger", plan["time"]))


def _take(run: RunData, message: Recorded) -> None:
    parts = message.topic.split("/")
    if parts[0] == "robot" and parts[-1] == "runs":
        for timing in json.loads(message.payload):
            run.done[parts[1], timing["input"]][timing["stamp"]] = _timing(timing)
    elif parts[0] == "robot" and parts[1] in run.dropped and _is_result(run, message.topic):
        value = json.loads(message.payload)
        run.results[message.topic].append(Result(value.get("stamp", message.at) / 1e9, message.at / 1e9, value))
    elif parts[0] == "cgroup":
        run.counters[parts[1]].append(Counters(message.at / 1e9, json.loads(message.payload)["usage"]))
    elif parts[0] == "contextpolicy" and parts[-1] == "plan" and message.payload:
        run.plans.append(json.loads(message.payload))


_OWN = ("health", "alive", "profile", "order")
"""What robotkit reports of a task, and the orders that it gets, beside its results."""


def _is_result(run: RunData, key: str) -> bool:
    return key not in run.published and key.rpartition("/")[2] not in _OWN


def _timing(value: Mapping[str, Any]) -> Timing:
    return Timing(value["finished"] / 1e9, value["cpu"] / 1e9, value["dropped"])
