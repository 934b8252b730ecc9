"""Closing loops, on the recording with two laps: made once, then cached in build/datasets."""

from __future__ import annotations

import pytest

from modules.slam import estimates
from modules.slam.evaluation import evaluate
from modules.slam.trajectory import load
from timelines.datasets.recordings import ROOT, make


@pytest.fixture(scope="module")
def loops():
    make(ROOT, "loops", lambda _: None)
    return ROOT / "loops"


def scored(folder, *, loops):
    estimate = estimates.run(folder, loops=loops)
    assert (estimate.lost, estimate.broken) == (0, 0)
    return evaluate(estimate.trajectory, load(folder))


def test_loops_bring_the_drift_of_the_end_under_a_third_of_odometrys(loops):
    slam, odometry = scored(loops, loops=True), scored(loops, loops=False)
    assert slam["compared"] == odometry["compared"] == 370
    assert slam["end_drift"] < odometry["end_drift"] / 3
    assert slam["ate"]["rmse"] < odometry["ate"]["rmse"]
    assert slam["ate"]["rmse"] < 0.002 * slam["path"]
    assert odometry["end_drift"] < 0.01 * odometry["path"]
