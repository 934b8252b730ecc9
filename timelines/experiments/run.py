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
from timelines.demo import deploy
from timelines.experiments import installation
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder
from timelines.replay.player import TimelineInputs, publish

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import zenoh

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.configurations import Configuration

RUN, MESSAGES = "run.json", "run.mcap"
HEALTH, PROFILE = "robot/*/health", "robot/*/profile"
PATIENCE = 120.0
"""Seconds to wait for modules that start, and for queues that empty."""
SETTLING = 2.0
"""Seconds after the last input before an empty queue counts: a starved task fetches late what was sent to it."""


class Healths:
    """The latest health message of each task. Pure but for the callback's thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._latest: dict[str, dict[str, Any]] = {}

    def hear(self, sample: zenoh.Sample) -> None:
        """Take one message."""
        with self._changed:
            self._latest[str(sample.key_expr).split("/")[1]] = json.loads(sample.payload.to_bytes())
            self._changed.notify_all()

    def wait_for_all(self, tasks: tuple[str, ...], since: float) -> bool:
        """Wait until each task has said, after `since` (Unix seconds), that nothing waits; False if one does not."""
        with self._changed:
            return self._changed.wait_for(lambda: all(idle(self._latest.get(task), since) for task in tasks), PATIENCE)


def idle(health: Mapping[str, Any] | None, since: float) -> bool:
    """Whether a task had nothing to do, or may not do it, when it said so after `since`."""
    return health is not None and health["stamp"] > since * 1e9 and (health["suspended"] or not health["queue"])


def execute(configuration: Configuration, timeline: Path, datasets: Path, folder: Path) -> None:
    """Do the run and keep its raw data; the folder counts as finished once it has a run.json."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    installation.start_robot(configuration, folder)
    try:
        story = load(timeline)
        with (
            installation.session(configuration, "sensor") as sensors,
            installation.session(configuration, "viewer") as viewer,
        ):
            about = _record(configuration, story, datasets, folder / MESSAGES, sensors, viewer)
        shutil.copyfile(timeline, folder / "timeline.json")
        (folder / RUN).write_text(json.dumps(about, indent=1), encoding="utf-8")
    finally:
        installation.stop_robot()


def _record(  # noqa: PLR0913, PLR0917 - what one run is made of
    configuration: Configuration,
    story: Timeline,
    datasets: Path,
    path: Path,
    sensors: zenoh.Session,
    viewer: zenoh.Session,
) -> dict[str, Any]:
    healths = Healths()
    viewer.declare_subscriber(HEALTH, healths.hear)
    begun = time.time()
    if not healths.wait_for_all(deploy.TASKS, begun):
        raise deploy.DeployError(f"not all of {', '.join(deploy.TASKS)} told their health within {PATIENCE:g} s")
    installation.decide(configuration, path.parent)
    named = [entry.key for entry in story.entries if entry.dataset is not None]
    load_before = os.getloadavg()
    with McapWriter(path) as file:
        with BusRecorder(viewer, file, installation.cgroups(), without_payload=named):
            report = publish(TimelineInputs(story, datasets), sensors, stop=threading.Event())
            drained = healths.wait_for_all(deploy.TASKS, report.finished + SETTLING)
            counted = _counted(viewer)
        file.describe({name: json.dumps(value) for name, value in report.as_json().items()})
    return {
        "configuration": configuration.name,
        "title": configuration.title,
        "player": report.as_json(),
        "stamps": report.stamps,
        "counted": counted,
        "drained": drained,
        "date": dt.datetime.now(tz=dt.UTC).isoformat(timespec="seconds"),
        "machine": _machine(),
        "load": {"before": load_before, "after": os.getloadavg()},
        "inputs": {task: _inputs(task) for task in deploy.TASKS},
        "deadlines": {task: installation.module_file(task)["needs"].get("deadline") for task in deploy.TASKS},
    }


def _counted(session: zenoh.Session) -> dict[str, dict[str, int]]:
    """How many samples of each input each task says it has done, to check the recording against."""
    answers = [json.loads(reply.ok.payload.to_bytes()) for reply in session.get(PROFILE, timeout=10.0) if reply.ok]
    return {one["task"]: {name: own["done"] for name, own in one["inputs"].items()} for one in answers}


def _inputs(task: str) -> dict[str, str]:
    return {name: entry["key"] for name, entry in installation.module_file(task)["inputs"].items()}


def _machine() -> dict[str, Any]:
    with open("/proc/cpuinfo", encoding="utf-8") as file:  # noqa: PTH123 - a file of the kernel
        models = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processor": models[0] if models else platform.machine(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory, 1),
        "kernel": platform.release(),
    }
