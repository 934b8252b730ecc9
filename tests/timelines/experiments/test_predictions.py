"""Predictions before the runs, from profiles of other runs."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml

from contextpolicy.simulation.profiles import parse_profiles
from contextpolicy.streams.timeline import parse
from tests.timelines.experiments.made_up import MEASURED
from timelines.experiments.capacity import Capacity, in_cpu_time
from timelines.experiments.due import Schedule, Window
from timelines.experiments.predictions import PREDICTED, predict, slowed_down
from timelines.experiments.stories import HELD_OUT

TIMELINE = parse({
    "name": "short", "duration": 4.0,
    "inputs": [
        {"key": "robot/camera/stereo", "encoding": "binary", "from": 0, "to": 4, "dataset": "x/stereo", "rate": 10},
        {"key": "robot/mission", "encoding": "json", "from": 0, "to": 4, "rate": 5, "value": {"does": "drive"}},
    ],
})  # fmt: skip
DUE = Schedule(
    4.0, {"robot/camera/stereo": [n / 10 for n in range(40)]}, {"slam": {"stereo": "robot/camera/stereo"}},
    {"slam": 0.1}, [Window(0.0, 4.0, ("drive",), frozenset())],
)  # fmt: skip
POLICY = yaml.safe_load(HELD_OUT[0].policy_file.read_text(encoding="utf-8"))


def test_on_slower_processors_the_same_input_takes_longer():
    slam = slowed_down(parse_profiles(MEASURED), 0.5).tasks["slam"]
    assert slam.inputs[0].quantiles == (0.1, 0.1)
    assert slam.background == pytest.approx(0.02)


def test_on_slower_processors_a_bound_is_a_larger_part_of_one():
    tasks = {task["name"]: task for task in in_cpu_time(POLICY, 0.25)["spec"]["tasks"]}
    assert (tasks["imu"]["min"], tasks["imu"]["max"]) == ("1", "1200m")
    assert "min" not in tasks["slam"]


def predicted(part, due=DUE):
    return predict(POLICY, TIMELINE, due, slowed_down(parse_profiles(MEASURED), part), Capacity(1, part))


def test_each_configuration_is_predicted():
    fast, slow = predicted(1.0), predicted(0.3)
    assert set(fast) == {one.name for one in PREDICTED}
    assert fast["weights-gated"]["slam"] == 0
    assert slow["weights-gated"]["slam"] > 0.5  # 170 ms an input, ten times a second


def test_a_prediction_is_of_what_the_runs_are_counted_by():
    """The deadlines that were frozen, not the module's own; and only what its context wants."""
    assert predicted(0.6)["weights-gated"]["slam"] == 0  # 85 ms
    assert predicted(0.6, replace(DUE, deadlines={"slam": 0.05}))["weights-gated"]["slam"] == 1
    unwanted = [Window(0.0, 3.0, ("talk",), frozenset({"slam"})), Window(3.0, 4.0, ("drive",), frozenset())]
    assert predicted(0.3, replace(DUE, windows=unwanted))["weights-gated"]["slam"] > 0.5
    assert "slam" not in predicted(0.3, replace(DUE, windows=unwanted[:1]))["weights-gated"]
