"""What SLAM makes of bad light and of cameras that are not where the calibration says, on a few seconds of corridor."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.slam import trust
from modules.slam.refinement import Offset
from modules.slam.slam import State
from modules.slam.tracking import Fix
from modules.slam.trust import doubt, stereo_doubt
from tests.modules.slam.recording import pictures, slam, track


@pytest.fixture(scope="module")
def frames(short):
    return [pair for _, *pair in pictures(short)]


def run(pairs):
    module = slam()
    return [track(module, left, right) for left, right in pairs]


def position(pose):
    return pose.world_from_body[:3, 3]


def test_little_light_is_enough(frames):
    bright = run(frames[:30:3])
    dark = run([[(picture * 0.08).astype(np.uint8) for picture in pair] for pair in frames[:30:3]])
    assert {pose.state for pose in dark} == {State.TRACKING}
    assert position(dark[-1]) == pytest.approx(position(bright[-1]), abs=0.1)


def test_the_same_picture_twice_has_no_depth(frames):
    poses = run([(left, left) for left, _ in frames[:5]])
    assert {pose.state for pose in poses} == {State.LOST}
    assert [position(pose) for pose in poses] == [pytest.approx(np.zeros(3), abs=1e-9)] * 5


def shifted(picture, columns, rows):
    return cv2.warpAffine(picture, np.array([[1.0, 0, columns], [0, 1, rows]]), picture.shape[::-1])


@pytest.mark.parametrize("shift", [(-8, 0), (8, 0), (0, 8)])
def test_a_camera_that_was_knocked_is_not_trusted(frames, shift):
    poses = run([(left, shifted(right, *shift)) for left, right in frames])
    assert sum(pose.state is State.TRACKING for pose in poses[10:]) <= 4


def fix(spread=0.01, offset=0.0, why=None, **changes):
    keyframe = type("K", (), {"points": np.full((3, 3), 2.0), "doubt": why})()
    values = {"inliers": 200, "tried": 250, "misfit": 1.0} | changes
    return Fix(keyframe, np.eye(4), covariance=np.eye(6) * spread**2, offset=Offset(offset), **values)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, None),
        ({"inliers": trust.FEW - 1, "tried": 40}, "few landmarks"),
        ({"tried": 1000}, "landmarks disagree"),
        ({"misfit": 2.0}, "landmarks do not fit"),
        ({"spread": 0.2}, "view says too little"),
        ({"offset": -trust.MOST_OFFSET - 0.1}, "cameras disagree"),
        ({"why": "cameras disagree"}, "cameras disagree"),
    ],
)
def test_a_pose_is_doubted_for_one_of_these(changes, why):
    assert doubt(fix(**changes)) == why


def test_cameras_disagree_when_most_landmarks_have_another_distance_than_before():
    assert stereo_doubt(fix(), fix(inliers=150)) is None
    assert stereo_doubt(fix(), fix(inliers=60)) == "cameras disagree"
    assert stereo_doubt(fix(), fix(offset=trust.MOST_OFFSET + 0.1)) == "cameras disagree"
