"""A run that never was: two tasks, ten inputs each at 10 Hz, and plans, with times that can be checked by hand."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

from timelines.experiments.run import MESSAGES, RUN
from timelines.recording.mcap_file import McapWriter

if TYPE_CHECKING:
    from pathlib import Path

BEGIN = 1_795_300_000.0
S = 1_000_000_000
TIMELINE = {
    "name": "exp3",
    "duration": 1.0,
    "phases": [
        {"name": "stands", "from": 0, "to": 0.5, "truth": {"moving": False}},
        {"name": "drives", "from": 0.5, "to": 1.0, "truth": {"moving": True}},
    ],
    "inputs": [{"key": "robot/imu", "encoding": "json", "at": 0, "value": {"speed": 0.3}}],
}
INPUTS = {"slam": {"stereo": "robot/camera/stereo"}, "speech": {"audio": "robot/microphone"}}
DEADLINES = {"slam": "100ms", "speech": "1s"}


def write_run(folder, configuration, title, *, service, **story):
    """`service` is each task's seconds an input, one after the other; `skipped` are (task, index) never done.

    Each of the `plans` is (seconds, suspended tasks, share of slam); limits follow 0.05 s later.
    """
    plans = story.get("plans", ())
    with McapWriter(folder / MESSAGES) as file:
        messages = sorted(
            [*_runs(service, story.get("skipped", ())), *_plans(plans), *_counters(plans)],
            key=lambda m: m[0],
        )
        for at, key, value in messages:
            moment = round((BEGIN + at) * S)
            if key.startswith("cgroup/"):
                file.counted(key, "cgroup", value, moment)
            else:
                file.heard(key, "json", json.dumps(value).encode(), received=moment, stamp=moment)
    (folder / "timeline.json").write_text(json.dumps(TIMELINE), encoding="utf-8")
    (folder / RUN).write_text(json.dumps(_about(configuration, title, story)), encoding="utf-8")
    return folder


def stamp(index):
    return round((BEGIN + index / 10) * S)


def _runs(service, skipped):
    for task, inputs in INPUTS.items():
        free = 0.0
        for index in (index for index in range(10) if (task, index) not in skipped):
            started = max(free, index / 10)
            free = started + service[task]
            times = {"started": round((BEGIN + started) * S), "finished": round((BEGIN + free) * S)}
            value = {"input": next(iter(inputs)), "stamp": stamp(index), "cpu": round(service[task] * S), **times}
            yield free, f"robot/{task}/runs", [value]


def _plans(plans):
    for sequence, (at, suspended, share) in enumerate(plans, start=1):
        tasks = {
            task: {"share": share if task == "slam" else 0.5, "weight": 1.0, "suspended": task in suspended}
            for task in INPUTS
        }
        moment = BEGIN + at
        head = {"run": 1, "sequence": sequence, "edition": 0, "time": moment, "trigger": moment}
        contexts = ["moving"] if suspended else []
        yield at, "contextpolicy/robot/whole-robot/plan", {**head, "contexts": contexts, "tasks": tasks}


def _counters(plans):
    for tick in range(21):
        at = tick / 10 + 0.05
        share = next((share for begun, _, share in reversed(plans) if begun + 0.05 <= at), None)
        for task in INPUTS:
            limit = share if task == "slam" or share is None else 0.5
            yield at, f"cgroup/{task}", {"limit": limit, "usage": at * 0.4, "throttledTime": 0.0}


def _about(configuration, title, story):
    stamps = {key: [stamp(index) for index in range(10)] for inputs in INPUTS.values() for key in inputs.values()}
    return {
        "configuration": configuration,
        "title": title,
        "player": {"started": BEGIN, "finished": BEGIN + 1.0},
        "stamps": stamps,
        "counted": {"speech": {"audio": 10}},
        "drained": story.get("drained", True),
        "pace": story.get("pace", 1.0),
        "date": "2026-11-22T03:00:00+00:00",
        "machine": {"processor": "a test", "cores": 2, "memory_gib": 4.0, "kernel": "6"},
        "busy": 3.0,
        "load": {"before": [0.5, 0, 0], "after": [0.5, 0, 0]},
        "inputs": INPUTS,
        "deadlines": DEADLINES,
    }


def fresh(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder
