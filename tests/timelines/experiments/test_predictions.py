"""Predictions before the runs, from profiles of other runs."""

from __future__ import annotations

import pytest
import yaml

from contextpolicy.simulation.profiles import parse_profiles
from contextpolicy.streams.timeline import parse
from timelines.experiments.capacity import Capacity, in_cpu_time
from timelines.experiments.predictions import PREDICTED, predict, slowed_down
from timelines.experiments.stories import HELD_OUT

COST = {"mean": 0.05, "std": 0.0, "quantiles": [0.05, 0.05]}
PROFILE = {
    "deadline": 0.1,
    "background": 0.01,
    "seconds": 15.0,
    "produced": {"done": 0, "cpu": {"mean": None}},
    "inputs": {"stereo": {"key": "robot/camera/stereo", "depth": 1, "cpu": COST, "service": COST}},
}
MEASURED = {"measured": "2026-11-26T00:00:00+00:00", "tasks": {"slam": PROFILE}}
TIMELINE = parse({
    "name": "short", "duration": 4.0,
    "inputs": [
        {"key": "robot/camera/stereo", "encoding": "binary", "from": 0, "to": 4, "dataset": "x/stereo", "rate": 10},
        {"key": "robot/mission", "encoding": "json", "from": 0, "to": 4, "rate": 5, "value": {"does": "drive"}},
    ],
})  # fmt: skip
POLICY = yaml.safe_load(HELD_OUT[0].policy_file.read_text(encoding="utf-8"))


def test_on_slower_processors_the_same_input_takes_longer():
    slam = slowed_down(parse_profiles(MEASURED), 0.5).tasks["slam"]
    assert slam.inputs[0].quantiles == (0.1, 0.1)
    assert slam.background == pytest.approx(0.02)


def test_on_slower_processors_a_bound_is_a_larger_part_of_one():
    tasks = {task["name"]: task for task in in_cpu_time(POLICY, 0.25)["spec"]["tasks"]}
    assert (tasks["imu"]["min"], tasks["imu"]["max"]) == ("1", "1200m")
    assert "min" not in tasks["slam"]


def test_each_configuration_is_predicted():
    same = predict(POLICY, TIMELINE, MEASURED, Capacity(1, 0.5), 0.5)  # of processors as slow as these
    fast, slow = (predict(POLICY, TIMELINE, MEASURED, Capacity(1, part)) for part in (1.0, 0.3))
    assert set(fast) == {one.name for one in PREDICTED}
    assert same["weights-gated"] == fast["weights-gated"]
    assert fast["weights-gated"]["slam"] == 0
    assert slow["weights-gated"]["slam"] > 0.5  # 170 ms an input, ten times a second
