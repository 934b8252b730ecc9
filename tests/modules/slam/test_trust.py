"""What SLAM makes of bad light and of cameras that are not where the calibration says, on a few seconds of corridor."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from modules.slam import trust
from modules.slam.calibration import Rectifier, load_rig
from modules.slam.geometry import floats, transform
from modules.slam.refinement import FADING, LEAST_SPREAD, Offset
from modules.slam.slam import Effort, State, StereoSlam
from modules.slam.tracking import Fix
from modules.slam.trajectory import load
from modules.slam.trust import depth_doubt, doubt, scale_spread, stereo_doubt
from tests.modules.slam.recording import pictures, slam, track
from timelines.datasets import euroc as generator


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


def test_what_a_lamp_lights_is_enough(frames):
    columns, rows = np.meshgrid(np.linspace(-2.5, 2.5, 752), np.linspace(-2.2, 2.2, 480))
    light = np.exp(-((columns**2 + rows**2) ** 2))
    lit = run([[(picture * light).astype(np.uint8) for picture in pair] for pair in frames[:30:3]])
    assert State.LOST not in {pose.state for pose in lit}
    assert position(lit[-1]) == pytest.approx(position(run(frames[:30:3])[-1]), abs=0.05)


@pytest.mark.parametrize("gain", [0.1, 0.5, 0.77, 1.3])
def test_cameras_of_unequal_brightness_agree(frames, gain):
    unequal = run([(left, cv2.convertScaleAbs(right, alpha=gain)) for left, right in frames])
    assert {pose.state for pose in unequal} == {State.TRACKING}
    assert position(unequal[-1]) == pytest.approx(position(run(frames)[-1]), abs=0.01)


def test_the_same_picture_twice_has_no_depth(frames):
    poses = run([(left, left) for left, _ in frames[:5]])
    assert {pose.state for pose in poses} == {State.LOST}
    assert [position(pose) for pose in poses] == [pytest.approx(np.zeros(3), abs=1e-9)] * 5


def test_the_same_picture_twice_is_doubted_where_turned_cameras_see_depth_in_it(frames):
    rig = load_rig(generator.RIG)
    turn = transform(floats(cv2.Rodrigues(np.array([0, np.radians(-8), 0]))[0]), np.zeros(3))
    turned = replace(rig, right=replace(rig.right, body_from_camera=rig.right.body_from_camera @ turn))
    module = StereoSlam(Rectifier(turned))
    poses = [track(module, left, left) for left, _ in frames[:5]]
    assert {(pose.state, pose.doubt) for pose in poses} == {(State.DEGRADED, "cameras disagree")}


def shifted(picture, columns, rows):
    return cv2.warpAffine(picture, np.array([[1.0, 0, columns], [0, 1, rows]]), picture.shape[::-1])


@pytest.mark.parametrize("shift", [(-8, 0), (8, 0), (0, 8)])
def test_a_camera_that_was_knocked_is_not_trusted(frames, shift):
    poses = run([(left, shifted(right, *shift)) for left, right in frames])
    assert sum(pose.state is State.TRACKING for pose in poses[10:]) <= 4


def fix(spread=0.01, offset=0.0, unsure=0.0, moved=0.0, why=None, **changes):
    keyframe: Any = SimpleNamespace(points=np.full((3, 3), 2.0), doubt=why)
    values = {"inliers": 200, "tried": 250, "misfit": 1.0, "disparity": 20.0} | changes
    found = Offset(offset, unsure, moved)
    return Fix(keyframe, np.eye(4), covariance=np.eye(6) * spread**2, offset=found, **values)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, None),
        ({"inliers": trust.FEW - 1, "tried": 40}, "few landmarks"),
        ({"tried": 1000}, "landmarks disagree"),
        ({"misfit": 2.0}, "landmarks do not fit"),
        ({"spread": 0.2}, "view says too little"),
        ({"offset": -2.4, "disparity": 200.0}, None),
        ({"offset": -2.6, "disparity": 200.0}, "cameras disagree"),
        ({"why": "cameras disagree"}, "cameras disagree"),
        ({"offset": -0.2}, None),
        ({"offset": -0.9}, "scale uncertain"),
        ({"offset": -0.9, "disparity": 60.0}, None),
        ({"offset": -0.2, "disparity": 8.0}, "scale uncertain"),
        ({"unsure": 0.5}, "scale uncertain"),
        ({"moved": 0.9}, "scale uncertain"),
        ({"disparity": 2.0}, "scale uncertain"),
    ],
)
def test_a_pose_is_doubted_for_one_of_these(changes, why):
    assert doubt(fix(**changes), 5.0) == why


def test_the_scale_is_not_doubted_where_it_makes_less_than_a_centimetre():
    assert [doubt(fix(unsure=0.5), metres) for metres in (0.0, 0.39, 0.41)] == [None, None, "scale uncertain"]


def test_cameras_disagree_when_few_corners_have_a_depth():
    assert depth_doubt(known=250, corners=800) is None
    assert depth_doubt(known=150, corners=800) == "cameras disagree"


def test_scale_uncertainty_follows_the_disparities_of_landmarks():
    assert scale_spread(fix(offset=-1.0)) == pytest.approx(0.025, rel=0.01)
    assert scale_spread(fix(offset=-1.0, disparity=10.0)) == pytest.approx(0.05, rel=0.01)
    assert scale_spread(fix()) == pytest.approx(LEAST_SPREAD / 20)


def test_scale_uncertainty_follows_what_is_known_of_the_offset_and_how_far_it_moved():
    assert scale_spread(fix(unsure=0.5)) == pytest.approx(0.025)
    assert scale_spread(fix(offset=0.1, moved=1.0)) == pytest.approx(0.025, rel=0.01)


def deviation(pose):
    return np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1])


def knocked(pixels):
    """Pictures of a right camera that is turned by so many pixels against its calibration."""
    return lambda left, right: (left, shifted(right, pixels, 0))


def test_a_camera_slightly_turned_is_corrected_but_its_scale_is_uncertain(frames):
    poses = run([knocked(1.5)(*pair) for pair in frames])
    assert {pose.doubt for pose in poses[-15:]} == {"scale uncertain"}
    assert {pose.doubt for pose in run(frames)} == {None}


@pytest.mark.parametrize("pixels", [-1.5, 0, 1.5])
def test_the_published_deviation_covers_the_error_from_the_first_step_on(short, frames, pixels):
    truth = load(short)
    places = truth.positions[np.searchsorted(truth.stamps, [stamp for stamp, *_ in pictures(short)])]
    poses = run([knocked(pixels)(*pair) for pair in frames])
    for place, pose in zip(places, poses, strict=True):
        error = np.linalg.norm(position(pose)) - np.linalg.norm(place - places[0])
        assert abs(error) <= max(2 * deviation(pose), 1e-4)


def test_the_published_deviation_shrinks_as_the_offset_becomes_known(frames):
    poses = run(frames)
    first, last = (deviation(poses[number]) / np.linalg.norm(position(poses[number])) for number in (8, -1))
    assert (first > 0.03, last < 0.006) == (True, True)


@pytest.mark.parametrize("start", [5, 25])
@pytest.mark.parametrize("pixels", [-8, -4, -2, -1, -0.5, 0.5, 1, 2, 4, 8])
def test_a_camera_that_is_knocked_on_the_way_is_doubted_from_the_next_keyframe_on(frames, pixels, start):
    module = slam()
    module.effort = Effort(overlap=0.95)  # the second one, with which the offset becomes known, comes between 5 and 25
    for left, right in frames[:start]:
        track(module, left, right)
    poses = [track(module, *knocked(pixels)(left, right)) for left, right in frames[start:]]
    kept = next(number for number, pose in enumerate(poses) if pose.is_keyframe)
    assert len(poses) - kept > 10
    assert State.TRACKING not in {pose.state for pose in poses[kept + 1 :]}
    assert position(poses[kept]) == pytest.approx(position(run(frames[: start + kept + 1])[-1]), abs=0.02)


@pytest.mark.parametrize("fails", [np.zeros_like, np.copy])
def test_a_second_camera_that_fails_is_doubted_as_soon_as_it_is_needed(frames, fails):
    module = slam()
    module.effort = Effort(overlap=0.95)
    poses = [track(module, left, right if number < 25 else fails(left)) for number, (left, right) in enumerate(frames)]
    assert {pose.doubt for pose in poses[:25]} == {None}
    assert poses[-1].doubt == "cameras disagree"
    assert position(poses[-1]) == pytest.approx(position(run(frames)[-1]), abs=0.02)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, None),
        ({"inliers": 150}, None),
        ({"inliers": 60}, "cameras disagree"),
        ({"misfit": 1.3}, None),
        ({"misfit": 1.5}, "cameras disagree"),
        ({"offset": -0.6}, None),
        ({"offset": -0.8}, "cameras disagree"),
    ],
)
def test_cameras_disagree_when_a_new_keyframe_measures_other_distances(changes, why):
    shown = fix(offset=-0.1, unsure=0.08)
    assert stereo_doubt(shown, fix(**changes)) == why
    assert stereo_doubt(shown, None) == "cameras disagree"


def test_cameras_disagree_beyond_two_and_a_half_pixels_whatever_was_known():
    assert stereo_doubt(fix(offset=2.4), fix(offset=2.45)) is None
    assert stereo_doubt(fix(offset=2.45), fix(offset=2.55)) == "cameras disagree"


def test_what_an_offset_moved_by_fades_from_keyframe_to_keyframe():
    learned = Offset().learned(Offset(-0.8, 0.01))
    assert (learned.pixels, learned.spread, learned.moved) == (-0.8, LEAST_SPREAD, 0.8)
    again = learned.learned(Offset(-0.7, 0.01))
    assert again.moved == pytest.approx(0.8 * FADING)
    assert again.forgotten() == Offset(-0.7, moved=again.moved)


def test_ten_keyframes_after_a_knock_by_a_pixel_little_of_it_is_left():
    known = Offset().learned(Offset(-1.0))
    after = [known := known.learned(Offset(-1.0)) for _ in range(10)]
    assert (after[1].moved > 0.4, after[-1].moved < 0.05) == (True, True)
