"""One run: the timeline is played once under one configuration, everything is recorded, and the queues are emptied."""

from __future__ import annotations

import datetime as dt
import json
import os
import platform
import shutil
import threading
import time
from typing import TYPE_CHECKING, Any

from contextpolicy.streams.timeline import load
from robotkit.profile import processor
from robotkit.profiles import document
from timelines.demo import deploy
from timelines.experiments import installation
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder
from timelines.replay.player import Options, TimelineInputs, publish

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import zenoh

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.trials import Trial
    from timelines.replay.player import Report

RUN, MESSAGES, TIMELINE, PROFILES = "run.json", "run.mcap", "timeline.json", "profiles.json"
HEALTH, PROFILE = "robot/*/health", "robot/*/profile"
PATIENCE = 120.0
"""Seconds to wait for modules that start, and for queues that empty."""
CALM = 3.0
"""Seconds between the start of pods and policy, which Kubernetes works on, and the first input."""
SETTLING = 2.0
"""Seconds after the last input before an empty queue counts: a starved task fetches late what was sent to it."""


class Healths:
    """The latest health message of each task, as a session hears them."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self._changed = threading.Condition()
        self._latest: dict[str, dict[str, Any]] = {}
        session.declare_subscriber(HEALTH, self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        """Take one message."""
        with self._changed:
            self._latest[str(sample.key_expr).split("/")[1]] = json.loads(sample.payload.to_bytes())
            self._changed.notify_all()

    def wait_until_ready(self) -> None:
        """Wait until all tasks of the robot are idle; DeployError if one does not report."""
        if not self.wait_for_all(deploy.TASKS, time.time()):
            raise deploy.DeployError(
                f"not all of {', '.join(deploy.TASKS)} reported their health within {PATIENCE:g} s"
            )

    def wait_for_all(self, tasks: tuple[str, ...], since: float) -> bool:
        """Wait until each task has said, after `since` (Unix seconds), that nothing waits; False if one does not."""
        with self._changed:
            return self._changed.wait_for(lambda: all(idle(self._latest.get(task), since) for task in tasks), PATIENCE)


def idle(health: Mapping[str, Any] | None, since: float) -> bool:
    """Whether a task was idle, or suspended, when it said so after `since`."""
    return health is not None and health["stamp"] > since * 1e9 and (health["suspended"] or not health["queue"])


def execute(trial: Trial, timeline: Path, datasets: Path, folder: Path, policy: Path = installation.POLICY) -> None:
    """Do the run and keep its raw data; the folder counts as finished once it has a run.json."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    wanted = installation.policy_document(trial.pace, policy)
    installation.start_robot(trial.configuration, wanted, folder)
    try:
        with (
            installation.session(trial.configuration, "sensor") as sensors,
            installation.session(trial.configuration, "module") as viewer,  # viewers hear no samples
        ):
            healths = Healths(viewer)
            healths.wait_until_ready()
            installation.decide(trial.configuration, wanted, folder)
            about = _record(trial, TimelineSource(load(timeline), datasets), folder, sensors, healths)
        shutil.copyfile(timeline, folder / TIMELINE)
        (folder / RUN).write_text(json.dumps(about, indent=1), encoding="utf-8")
    finally:
        installation.stop_robot()


class TimelineSource:
    """A timeline with its recordings, whole or what one task takes of it."""

    def __init__(self, story: Timeline, datasets: Path) -> None:
        self._story, self._datasets = story, datasets

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
        for task in deploy.TASKS:
            own = [key for key in _inputs(task).values() if key not in played]
            inputs = TimelineInputs(self._story, self._datasets, own)
            if own and inputs.encodings:
                played |= inputs.encodings.keys()
                yield inputs


def _record(
    trial: Trial, source: TimelineSource, folder: Path, sensors: zenoh.Session, healths: Healths
) -> dict[str, Any]:
    viewer = healths.session
    time.sleep(CALM)
    load_before, busy_before = os.getloadavg(), _busy()
    reports, drained = [], True
    with McapWriter(folder / MESSAGES) as file:
        with BusRecorder(viewer, file, installation.cgroups(), without_payload=source.recorded):
            for inputs in source.parts(alone=trial.configuration.alone):
                reports.append(publish(inputs, sensors, stop=threading.Event(), options=Options(rate=trial.pace)))
                drained &= healths.wait_for_all(deploy.TASKS, reports[-1].finished + SETTLING)
            busy = _busy() - busy_before
            profiles = _profiles(viewer)
        file.describe({name: json.dumps(value) for name, value in reports[0].as_json().items()})
    (folder / PROFILES).write_text(json.dumps(document(profiles, dt.datetime.now(dt.UTC)), indent=1), encoding="utf-8")
    return {
        "configuration": trial.configuration.name,
        "title": trial.configuration.title,
        "pace": trial.pace,
        "adaptive": any(one.get("adaptive", False) for one in profiles),
        **_played(reports),
        "counted": {one["task"]: {name: own["done"] for name, own in one["inputs"].items()} for one in profiles},
        "drained": drained,
        "date": dt.datetime.now(tz=dt.UTC).isoformat(timespec="seconds"),
        "machine": _machine(),
        "busy": round(busy, 2),
        "load": {"before": load_before, "after": os.getloadavg()},
        "inputs": {task: _inputs(task) for task in deploy.TASKS},
        "deadlines": {task: installation.module_file(task)["needs"].get("deadline") for task in deploy.TASKS},
    }


def _played(reports: list[Report]) -> dict[str, Any]:
    """What was published: stamps by key, and the player's own words on the first part, with the last one's end."""
    stamps = {key: own for report in reports for key, own in report.stamps.items()}
    return {"player": reports[0].as_json() | {"finished": reports[-1].finished}, "stamps": stamps}


def _profiles(session: zenoh.Session) -> list[dict[str, Any]]:
    """What each task says that its inputs cost: for predictions, and to check the recording against its counts."""
    return [json.loads(reply.ok.payload.to_bytes()) for reply in session.get(PROFILE, timeout=10.0) if reply.ok]


def _inputs(task: str) -> dict[str, str]:
    return {name: entry["key"] for name, entry in installation.module_file(task)["inputs"].items()}


def _busy() -> float:
    """CPU seconds that the whole machine has spent on anything, user and kernel, since it was booted."""
    with open("/proc/stat", encoding="ascii") as file:  # noqa: PTH123 - a file of the kernel
        user, nice, system, _idle, _waiting, hard, soft, *_ = map(int, file.readline().split()[1:])
    return (user + nice + system + hard + soft) / os.sysconf("SC_CLK_TCK")


def _machine() -> dict[str, Any]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory, 1),
        "kernel": platform.release(),
    }
