"""One run: the timeline is played once under one configuration, everything is recorded, and the queues are emptied."""

from __future__ import annotations

import datetime as dt
import json
import shutil
import threading
import time
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.streams.timeline import load
from robotkit.profiles import document
from timelines.demo import deploy
from timelines.experiments import confine, healths, installation
from timelines.experiments.blocks import UNSLOWED
from timelines.experiments.calm import wait_until_calm
from timelines.experiments.cpu_account import SLOWING, Account, machine_seconds
from timelines.experiments.executive import Executive
from timelines.experiments.gate import Gate
from timelines.experiments.healths import Healths
from timelines.experiments.machine import this_machine
from timelines.experiments.node_service import as_service
from timelines.experiments.raw_data import MESSAGES, PROFILES, RUN
from timelines.experiments.record import write_whole
from timelines.experiments.slowed import Untouched, slowed, speed
from timelines.experiments.tasks import inputs_of, tasks_of
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder
from timelines.replay.player import Report, TimelineInputs, publish

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    import zenoh

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.blocks import Trial
    from timelines.experiments.capacity import Capacity
    from timelines.experiments.slowed import Thieves

PROFILE, RUNS = "robot/*/profile", "robot/*/runs"
LONG = 60.0
"""Seconds that an answer may take: a task on a slowed processor has thousands of runs to tell of."""
ASKED = 3
"""Times that the tasks are asked at most: of an answer this long a part may be lost where its task has little CPU."""
SETTLING = 2.0
"""Seconds after the last input before an empty queue counts: a starved task fetches late what was sent to it."""

BACKLOG = 2
"""Times a story's length that a queue which drops nothing may take to empty; who is given up looks quicker."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a run happens under: its timeline and recordings, and what the tasks share.

    `whole` turns of the loop a second count as a whole processor; a second of CPU is `expected` to do so many turns.
    `weights` are the searched ones, for a configuration that has static weights. `code` is the commit that runs.
    """

    timeline: Path
    datasets: Path
    capacity: Capacity
    whole: float
    expected: float
    weights: Mapping[str, int]
    code: str


def execute(trial: Trial, conditions: Conditions, folder: Path) -> None:
    """Do the run and keep its raw data; the folder counts as finished once it has a run.json."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    wait_until_calm()  # what stops or starts on the other processors slows this one
    speed_there = conditions.expected / conditions.whole
    installation.start_robot(trial, conditions.weights, folder)
    try:
        with (
            installation.session("sensor") as sensors,
            installation.session("module") as viewer,  # viewers hear no samples
        ):
            heard = Healths(viewer)
            heard.wait_until_ready(tasks_of(trial.story))
            gate: AbstractContextManager[object] = Gate(viewer) if trial.configuration.relayed else nullcontext()
            with gate:
                installation.decide(trial, conditions.capacity, speed_there, folder)
                found = _Recording(trial, conditions, sensors, viewer, heard).make(folder)
        write_whole(folder / RUN, json.dumps(found).encode())
    finally:
        installation.stop_robot()


class TimelineSource:
    """A timeline with its recordings, whole or what one of these tasks takes of it."""

    def __init__(self, story: Timeline, datasets: Path, tasks: Sequence[str]) -> None:
        self._story, self._datasets, self._tasks = story, datasets, tasks

    @property
    def recorded(self) -> list[str]:
        """The keys whose inputs come from recordings: those need no copy."""
        return [entry.key for entry in self._story.entries if entry.dataset is not None]

    def parts(self, *, alone: bool) -> Iterator[TimelineInputs]:
        """All inputs at once, or each task's by themselves; a key is played once."""
        if not alone:
            yield TimelineInputs(self._story, self._datasets)
            return
        played: set[str] = set()
        for task in self._tasks:
            own = [key for key in inputs_of(task).values() if key not in played]
            inputs = TimelineInputs(self._story, self._datasets, own)
            if own and inputs.encodings:
                played |= inputs.encodings.keys()
                yield inputs


class _Recording:
    """Plays, and records what follows."""

    def __init__(
        self,
        trial: Trial,
        conditions: Conditions,
        sensors: zenoh.Session,
        viewer: zenoh.Session,
        heard: Healths,
    ) -> None:
        self._trial, self._conditions, self._sensors, self._viewer = trial, conditions, sensors, viewer
        self._healths = heard
        self._tasks = tasks_of(trial.story)
        self._source = TimelineSource(load(conditions.timeline), conditions.datasets, self._tasks)

    def make(self, folder: Path) -> dict[str, Any]:
        """Record the run, and say what else has to be known of it."""
        capacity, cgroups = self._conditions.capacity, installation.cgroups(self._tasks)
        processors = confine.first(capacity.processors)
        confine.confine(cgroups, self._tasks, processors)
        calm = wait_until_calm()
        with (
            confine.keep_off(processors),
            as_service(cgroups.values()),
            self._slowed(processors) as thieves,
            self._punctual(),
            McapWriter(folder / MESSAGES) as file,
        ):
            parts = {SLOWING: thieves.seconds, **{name: cgroup.usage for name, cgroup in cgroups.items()}}
            with (
                BusRecorder(self._viewer, file, cgroups, without_payload=self._source.recorded),
                Executive(self._viewer, self._sensors) as executive,
            ):
                began = time.monotonic()
                with Account(machine_seconds, parts) as account:
                    reports, drained = self._play()
                took = time.monotonic() - began
            profiles = [json.loads(one) for one in answers(self._viewer, PROFILE, self._tasks).values()]
            for key, payload in answers(self._viewer, RUNS, self._tasks).items():
                file.heard(key, "json", payload, received=time.time_ns(), stamp=time.time_ns())
            confine.check(cgroups, self._tasks, processors)
            file.describe({name: json.dumps(value) for name, value in reports[0].as_json().items()})
        kept = document(profiles, dt.datetime.now(dt.UTC))
        (folder / PROFILES).write_text(json.dumps(kept), encoding="utf-8")
        about = {
            "date": dt.datetime.now(tz=dt.UTC).isoformat(timespec="seconds"),
            "machine": this_machine(),
            "code": self._conditions.code,
            "load": calm,
            "capacity": list(capacity),
            "whole": round(self._conditions.whole),
            "expected": round(self._conditions.expected),
            "pace": thieves.pace()._asdict(),
            "seconds": round(took, 2),
            "cpu": account.spent,
            "drained": drained,
        }
        if self._trial.configuration.static:
            about["weights"] = dict(self._conditions.weights)
        return {**_played(reports), **_heard(profiles), "orders": executive.sent, "about": about}

    def _slowed(self, processors: set[int]) -> AbstractContextManager[Thieves | Untouched]:
        """What leaves the tasks' processors their pace while they play."""
        if self._trial.load == UNSLOWED:
            return nullcontext(Untouched(speed(min(processors))))
        return slowed(self._conditions.capacity.part * self._conditions.whole, processors)

    def _punctual(self) -> AbstractContextManager[None]:
        """What keeps the player on time; not beside realtime tasks, which it would compete with."""
        return nullcontext() if self._trial.load == UNSLOWED else confine.punctual()

    def _play(self) -> tuple[list[Report], bool]:
        reports, drained = [], True
        for inputs in self._source.parts(alone=self._trial.configuration.alone):
            reports.append(publish(inputs, self._sensors, stop=threading.Event()))
            patience = healths.PATIENCE + BACKLOG * self._trial.story.seconds * self._trial.story.lossless
            drained &= self._healths.wait_for_all(self._tasks, reports[-1].finished + SETTLING, patience)
        return reports, drained


def answers(viewer: zenoh.Session, keys: str, tasks: Sequence[str]) -> dict[str, bytes]:
    """What each task answers, by its key; DeployError if one does not: what it did or dropped is unknown then."""
    found: dict[str, bytes] = {}
    silent = sorted(tasks)
    for _ in range(ASKED):
        replies = [reply.ok for reply in viewer.get(keys, timeout=LONG) if reply.ok is not None]
        found |= {str(reply.key_expr): reply.payload.to_bytes() for reply in replies}
        silent = sorted({*tasks} - {key.split("/")[1] for key in found})
        if not silent:
            return found
    raise deploy.DeployError(f"no answer on {keys} received from {', '.join(silent)}")


def _played(reports: list[Report]) -> dict[str, Any]:
    """What was published: stamps by key, and when the inputs began that each key belongs to."""
    return {
        "started": reports[0].started,
        "starts": {key: report.started for report in reports for key in report.stamps},
        "stamps": {key: own for report in reports for key, own in report.stamps.items()},
    }


def _heard(profiles: list[dict[str, Any]]) -> dict[str, Any]:
    """What the tasks say that they did and dropped."""
    return {
        what: {one["task"]: {name: own[what] for name, own in one["inputs"].items()} for one in profiles}
        for what in ("done", "dropped")
    }
