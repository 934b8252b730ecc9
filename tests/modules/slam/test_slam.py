"""How exact and how robust SLAM is, on pictures whose truth is known; the same everywhere, as all seeds are fixed."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from modules.slam import slam as steps
from modules.slam.slam import Effort, State
from modules.slam.trajectory import associate, load, trajectory
from modules.slam.trajectory_error import absolute_errors, statistics
from modules.slam.uncertainty import FAR_M
from tests.modules.slam.recording import BLACK, pictures, slam, track
from timelines.datasets import euroc
from timelines.datasets.motion import Motion

STILL_FRAMES = 5


@pytest.fixture(scope="module")
def frames(short):
    return list(pictures(short))


@pytest.fixture(scope="module")
def poses(frames):
    module = slam()
    return [(stamp, track(module, left, right)) for stamp, left, right in frames]


def position(pose):
    return pose.world_from_body[:3, 3]


def test_the_path_is_followed_within_one_percent(short, poses):
    reported = trajectory((stamp, (*position(pose), 0, 0, 0, 1)) for stamp, pose in poses)
    estimated, truth = associate(reported, load(short))
    length = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1).sum()
    assert (length > 1, len(estimated)) == (True, 50)
    assert statistics(absolute_errors(estimated, truth))["rmse"] < 0.01 * length


def test_every_frame_has_hundreds_of_inliers(poses):
    assert min(pose.inliers for _, pose in poses) > 200
    assert {pose.state for _, pose in poses} == {State.TRACKING}


def test_a_robot_that_stands_still_does_not_drift(poses):
    still = np.array([position(pose) for _, pose in poses[:STILL_FRAMES]])
    assert np.abs(still).max() < 0.001
    assert [pose.is_keyframe for _, pose in poses[:STILL_FRAMES]] == [True, False, False, False, False]


def test_the_second_picture_is_asked_for_only_when_there_is_a_new_keyframe(frames):
    module, asked, kept = slam(), 0, 0

    def second(picture):
        nonlocal asked
        asked += 1
        return picture

    for _, left, right in frames[:30]:
        kept += module.track(left, partial(second, right)).is_keyframe
    assert asked == kept < 10


def test_black_pictures_keep_the_last_pose():
    module = slam()
    reported = [track(module, BLACK, BLACK) for _ in range(2)]
    assert [(pose.inliers, pose.state) for pose in reported] == [(0, State.LOST)] * 2
    assert reported[1].world_from_body == pytest.approx(np.eye(4), abs=1e-9)


def test_after_blank_pictures_and_a_jump_the_robot_is_found_again(frames, poses):
    module = slam()
    for _, left, right in frames[:30]:
        track(module, left, right)
    blank = [track(module, BLACK, BLACK) for _ in range(steps.PATIENCE + 5)]
    assert {pose.state for pose in blank} == {State.LOST}
    assert position(blank[-1]) == pytest.approx(position(poses[29][1]), abs=0.02)
    for index in (3, 20):  # somebody carried it back, then further
        _, left, right = frames[index]
        pose = track(module, left, right)
        assert pose.state is State.TRACKING
        assert position(pose) == pytest.approx(position(poses[index][1]), abs=0.03)


def test_landmarks_found_by_features_are_trusted_as_they_are_seen(frames):
    module = slam()
    reported = []
    for _, left, right in frames:
        reported.append(track(module, left, right))
        for keyframe in module.map.keyframes.values():
            keyframe.image = None
    assert sum(pose.is_keyframe for pose in reported) > 5
    assert {pose.doubt for pose in reported} == {None}
    assert min(pose.inliers for pose in reported) > 350


def test_in_an_unknown_place_it_restarts_until_it_sees_the_old_one(frames, tmp_path):
    euroc.write(tmp_path, euroc.Sequence(Motion(0.1, ()), seed=8), progress=lambda _: None)
    ((_, *elsewhere),) = pictures(tmp_path)
    module = slam()
    for _, left, right in frames[:10]:
        track(module, left, right)
    there = [track(module, *elsewhere) for _ in range(steps.PATIENCE + 3)]
    assert [pose.state for pose in there] == [State.LOST] * steps.PATIENCE + [State.ADRIFT] * 3
    assert [pose.covariance is None for pose in there] == [True] * steps.PATIENCE + [False] * 3
    assert all(np.sqrt(pose.covariance[0, 0]) >= FAR_M for pose in there if pose.covariance is not None)
    assert track(module, *frames[10][1:]).state is State.TRACKING


def test_fewer_features_cost_inliers_but_not_the_path(frames, poses):
    module = slam()
    module.effort = Effort(features=300, overlap=0.35)
    reported = [track(module, left, right) for _, left, right in frames]
    assert all(0 < few.inliers <= 300 for few in reported)
    assert position(reported[-1]) == pytest.approx(position(poses[-1][1]), abs=0.05)


def test_the_map_stays_within_its_capacity(frames, monkeypatch):
    monkeypatch.setattr(steps, "CAPACITY", 1)
    module = slam()
    reported = [track(module, left, right) for _, left, right in frames]
    assert sum(pose.is_keyframe for pose in reported) > 1
    assert len(module.map.keyframes) == 1
    assert len(module._places._present) == 1
    assert {pose.state for pose in reported} == {State.TRACKING}
