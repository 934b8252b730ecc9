"""Runs that never were: two contexts, two tasks, ten inputs each, whose every ending is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from timelines.experiments.accounting import Ended, Ending
from timelines.experiments.capacity import WHOLE
from timelines.experiments.due import Schedule, Window
from timelines.experiments.evidence import Evidence
from timelines.experiments.record import Column, Record

SCHEDULE = Schedule(
    10.0,
    {"robot/camera/stereo": [float(n) for n in range(10)], "robot/microphone": [n + 0.5 for n in range(10)]},
    {"slam": {"stereo": "robot/camera/stereo"}, "speech": {"audio": "robot/microphone"}},
    {"slam": 0.1, "speech": 1.0},
    [Window(0.0, 5.0, ("drive",), frozenset()), Window(5.0, 10.0, ("talk",), frozenset({"slam"}))],
    [(6.0, 7.2)],
)
ABOUT: dict[str, Any] = {
    "date": "2026-11-26T03:00:00+00:00",
    "machine": {"processor": "a test", "cores": 2, "memory_gib": 4.0, "kernel": "6"},
    "code": "abc1234",
    "failures": [],
    "violations": [],
    "seconds": 10.0,
    "finished": 10.5,
    "cpu": {"machine": 8.0, "slowing": 1.0, "slam": 1.5, "speech": 0.25, "operator": 0.125, "router": 0.375},
    "load": 0.1,
    "drained": True,
    "capacity": [1, 0.4],
    "pace": {"speed": WHOLE, "left": 0.98, "worst": 0.95},
}


def column(endings, response=0.05, cpu=0.02):
    """`endings` are letters: i(n time), l(ate), d(ropped), s(uspended), o(n the way lost)."""
    letters = {"d": Ending.DROPPED, "s": Ending.SUSPENDED, "o": Ending.LOST}
    took = {"i": response, "l": 5.0}
    return Column.of([Ended(Ending.IN_TIME, took[one], cpu) if one in took else Ended(letters[one]) for one in endings])


def a_run(  # noqa: PLR0913 - what a run differs in, by keyword
    configuration, slam="i" * 10, speech="i" * 10, *, block=0, load="heavy", story="library", **more
):
    timing = {name: more.pop(name) for name in ("response", "cpu") if name in more}
    columns = {"slam": {"stereo": column(slam, **timing)}, "speech": {"audio": column(speech, **timing)}}
    late = {"robot/camera/stereo": [1] * 10}
    used = {"slam": [0, 20, 40], "speech": [0, 10, 20], "operator": [0, 1, 2], "router": [0, 1, 3]}
    plans = [[0, ["drive"], {"slam": [100.0, 1500], "speech": [3.0, 300]}],
             [5000, ["talk"], {"slam": [3.0, 300], "speech": [100.0, 1500]}]]  # fmt: skip
    commands = [[number, 600] for number, letter in enumerate(slam) if letter == "i"]
    whole: dict[str, Any] = {"plans": plans, "used": used, "commands": commands, "stops": [[0, 8000]], **more}
    return Record(load, story, configuration, block, columns, late, ABOUT, **whole)


def changed(record, **about):
    """With something else said of what it ran on."""
    return replace(record, about={**record.about, **about})


def at_speed(record, speed):
    """On processors so many times as fast as whole ones."""
    return changed(record, pace={**ABOUT["pace"], "speed": speed * WHOLE})


def evidence(*records, frozen=None, absent=()):
    runs: dict[tuple[str, str, str], dict[int, Record]] = {}
    for one in records:
        runs.setdefault((one.load, one.story, one.configuration), {})[one.block] = one
    return Evidence(dict.fromkeys({one.story for one in records}, SCHEDULE), runs, frozen or {}, absent)


FROZEN = {
    "loads": {"light": [2, 0.8], "heavy": [1, 0.8]},
    "asked": {"light": 0.7, "heavy": 1.21},
    "wanted": {"slam": 0.25, "speech": 0.02},
    "needs": {"drive": 0.31},
    "solo": {"slam": 1.0, "speech": 0.99},
    "deadlines": {"slam": 0.1, "speech": 1.0},
    "tuned": {
        "ungated": {"weights": {"slam": 120, "speech": 720}, "tried": []},
        "gated": {"weights": {"slam": 16, "speech": 16}, "tried": []},
    },
}
ACCURACY = {"slam": ["ATE", 0.02, "m", 90, False], "speech": ["commands heard", 75.0, "%", 4, True]}


def some_runs():
    for block in range(10):
        yield a_run("linux", slam="i" * 3 + "d" * 7, block=block, accuracy=ACCURACY)
        yield a_run("linux-gated", slam="i" * 3 + "dd" + "sssss", block=block, accuracy=ACCURACY)
        yield a_run("weights-gated", slam="i" * 5 + "sssss", block=block, accuracy=ACCURACY)
        yield a_run("static-gated", slam="ii" + "ddd" + "sssss", block=block, accuracy=ACCURACY)
    yield a_run("alone")
    for block in range(3):
        for name, finished in (("linux", 30.0), ("limits-gated", 20.0)):
            run = a_run(name, block=block, load="paper", story="exp1")
            yield replace(run, about={**run.about, "finished": finished})


COST = {"mean": 0.05, "std": 0.0, "quantiles": [0.05, 0.05]}
PROFILE = {
    "deadline": 0.1,
    "background": 0.01,
    "seconds": 15.0,
    "produced": {"done": 0, "cpu": {"mean": None}},
    "inputs": {"stereo": {"key": "robot/camera/stereo", "depth": 1, "cpu": COST, "service": COST}},
}
MEASURED = {"measured": "2026-11-26T00:00:00+00:00", "tasks": {"slam": PROFILE}}
"""Profiles: an input of SLAM takes 50 ms."""
