"""Closing loops, on the recording with two laps: made once, then cached in build/datasets."""

from __future__ import annotations

import numpy as np
import pytest

from modules.slam import estimates
from modules.slam.evaluation import evaluate
from modules.slam.trajectory import load
from timelines.datasets.recordings import LOOPS, ROOT, make


@pytest.fixture(scope="module")
def recording():
    make(ROOT, "loops", LOOPS, lambda _: None)
    return ROOT / "loops"


def scored(folder, *, loops):
    estimate = estimates.run(folder, loops=loops)
    assert (estimate.lost, estimate.broken) == (0, 0)
    return evaluate(estimate.trajectory, load(folder))


@pytest.fixture(scope="module")
def odometry(recording):
    return scored(recording, loops=False)


def test_the_path_leads_twice_around(recording):
    truth = load(recording)
    assert truth.poses[-1] == pytest.approx(np.eye(4), abs=0.2)
    assert np.linalg.norm(truth.positions[len(truth) // 4] - truth.positions[0]) > 0.8


def test_odometry_drifts(odometry):
    assert odometry["compared"] == 370
    assert odometry["path"] > 35
    assert 0.0005 * odometry["path"] < odometry["end_drift"] < 0.01 * odometry["path"]


def test_loops_bring_the_drift_of_the_end_under_half_of_odometrys(recording, odometry):
    slam = scored(recording, loops=True)
    assert slam["compared"] == odometry["compared"]
    assert slam["end_drift"] < odometry["end_drift"] / 2
    assert slam["ate"]["rmse"] < odometry["ate"]["rmse"]
    assert slam["ate"]["rmse"] < 0.0006 * slam["path"]
