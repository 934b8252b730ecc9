"""Predictions of runs, from what the runs kept."""

from __future__ import annotations

import json
import shutil

import pytest

from contextpolicy.simulation.forecast import ALL
from contextpolicy.streams.timeline import load
from timelines.demo import deploy
from timelines.experiments import prediction
from timelines.experiments.run import PROFILES, TIMELINE

STORY = deploy.REPOSITORY / "timelines" / "exp3.json"
COST = {"mean": 0.05, "std": 0.0, "quantiles": [0.05, 0.05]}
PROFILE = {
    "deadline": 0.1,
    "background": 0.0,
    "seconds": 15.0,
    "produced": {"done": 0, "cpu": {"mean": None}},
    "inputs": {"stereo": {"key": "robot/camera/stereo", "depth": 1000, "cpu": COST, "service": COST}},
}


def test_at_twice_the_rate_the_same_inputs_come_in_half_the_time():
    story = load(STORY)
    twice = story.at_rate(2.0)
    assert twice.duration == story.duration / 2
    before, after = ([one for one in reported.inputs() if one.dataset is None] for reported in (story, twice))
    assert [one.key for one in after] == [one.key for one in before]
    assert [one.at for one in after] == pytest.approx([one.at / 2 for one in before])


@pytest.fixture
def folder(tmp_path):
    shutil.copyfile(STORY, tmp_path / TIMELINE)
    shutil.copyfile(deploy.POLICY, tmp_path / prediction.POLICY)
    (tmp_path / PROFILES).write_text(json.dumps({"measured": "today", "tasks": {"slam": PROFILE}}), encoding="utf-8")
    return tmp_path


def test_a_finished_run_can_be_predicted(folder):
    slam = prediction.predict(folder, 1.0, 2).tasks["slam"][ALL]
    assert slam.inputs == 150
    assert slam.suspended > 50  # 1 s after the robot stands still
    assert slam.p50 is not None
    assert 0.05 <= slam.p50 < 0.1


def test_nothing_is_predicted_without_a_policy(folder):
    (folder / prediction.POLICY).unlink()
    assert list(prediction.compare(None, folder)) == []  # type: ignore[arg-type]  # nobody looks at the run
