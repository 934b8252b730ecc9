from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from modules.slam.features import Features
from modules.slam.geometry import transform
from modules.slam.map import Map
from modules.slam.pose_graph import Edge, Kind
from modules.slam.tracking import Fix
from modules.slam.uncertainty import ANY_RAD, FAR_M

PICTURE = np.zeros((4, 4), np.uint8)
STEP = np.diag([4e-4, 4e-4, 4e-4, 0, 0, 0])
"""What each step of a row adds: 2 cm of uncertainty."""


PICTURE = np.zeros((4, 4), np.uint8)
STEP = np.diag([4e-4, 4e-4, 4e-4, 0, 0, 0])
"""What each step of a row adds: 2 cm of uncertainty."""


def at(x, y=0.0):
    return transform(np.eye(3), np.array([x, y, 0.0]))


def add(known, pose, seen_from=None, between=None):
    view = SimpleNamespace(features=Features(np.zeros((3, 2)), np.zeros((3, 32), np.uint8)), image=PICTURE)
    points = np.array([[0, 0, 2.0], [1, 0, 3.0], [np.nan] * 3])
    fixes = [] if seen_from is None else [Fix(seen_from, between, 100, STEP)]
    return known.add(pose, view, points, fixes)


def row(known, count, start=0.0):
    keyframes = [add(known, at(start))]
    for index in range(1, count):
        keyframes.append(add(known, at(start + index), keyframes[-1], at(1)))
    return keyframes


def test_only_features_with_depth_are_landmarks():
    known = Map(10)
    row(known, 2)
    assert known.landmarks == 4


def test_a_true_loop_moves_the_map():
    known = Map(30)
    keyframes = row(known, 20)
    assert known.close(Edge(0, 19, at(18.9), 100, Kind.LOOP))
    assert keyframes[0].world_from_camera == pytest.approx(np.eye(4), abs=1e-6)
    assert keyframes[19].world_from_camera[0, 3] == pytest.approx(18.9, abs=0.05)
    assert 9.4 < keyframes[10].world_from_camera[0, 3] < 10


def test_a_loop_between_places_that_only_look_alike_is_refused():
    known = Map(30)
    keyframes = row(known, 20)
    assert not known.close(Edge(0, 19, at(12.0), 100, Kind.LOOP))
    assert keyframes[19].world_from_camera == pytest.approx(at(19), abs=1e-9)
    assert known.graph.near(0, 3) == [0, 1, 2]


@pytest.mark.parametrize("newer_first", [False, True])
def test_a_loop_joins_segments_after_a_loss_of_tracking(newer_first):
    known = Map(30)
    old = row(known, 3)
    new = row(known, 3, start=100.0)
    assert [keyframe.segment for keyframe in (*old, *new)] == [0, 0, 0, 1, 1, 1]
    loop = Edge(new[0].number, old[2].number, at(-5), 100) if newer_first else Edge(2, new[0].number, at(5), 100)
    assert known.close(loop)
    assert [keyframe.segment for keyframe in new] == [0, 0, 0]
    assert [keyframe.world_from_camera[0, 3] for keyframe in (*old, *new)] == pytest.approx([0, 1, 2, 7, 8, 9])


def test_the_oldest_keyframe_is_forgotten_and_the_origin_stays():
    known = Map(3)
    row(known, 4)
    assert known.forget() == 0
    assert known.forget() is None
    assert sorted(known.keyframes) == [1, 2, 3]
    assert known.keyframes[1].world_from_camera == pytest.approx(at(1))
    assert known.close(Edge(1, 3, at(2), 100, Kind.LOOP))


def test_beside_are_the_connected_keyframes_with_a_more_similar_view():
    known = Map(30)
    keyframes = row(known, 6)
    for x, beside in ((3.2, []), (3.8, [4]), (4.8, [5, 4])):
        assert [keyframe.number for keyframe in known.beside(keyframes[3], at(x), 2)] == beside


def uncertainty(keyframe):
    return np.sqrt(keyframe.covariance[0, 0])


def test_keyframes_are_less_and_less_sure_until_a_loop_closes():
    known = Map(30)
    keyframes = row(known, 17)
    assert [uncertainty(keyframes[number]) for number in (0, 1, 4, 16)] == pytest.approx([0, 0.02, 0.04, 0.08])
    assert known.close(Edge(0, 16, at(16), 100, Kind.LOOP, STEP))
    assert uncertainty(keyframes[16]) == pytest.approx(0.02)
    assert uncertainty(keyframes[12]) == pytest.approx(0.02 * np.sqrt(5))
    assert uncertainty(keyframes[4]) == pytest.approx(0.04)


def test_a_new_segment_may_be_anywhere_until_a_loop_joins_it():
    known = Map(30)
    row(known, 3)
    adrift = row(known, 3, start=100.0)
    assert min(uncertainty(keyframe) for keyframe in adrift) >= FAR_M
    assert np.sqrt(adrift[2].covariance[5, 5]) == pytest.approx(ANY_RAD)
    assert known.close(Edge(2, adrift[0].number, at(5), 100, Kind.LOOP, STEP))
    assert [uncertainty(keyframe) for keyframe in adrift] == pytest.approx(0.02 * np.sqrt([3, 4, 5]))


def test_only_the_newest_keyframes_keep_their_picture():
    keyframes = row(Map(30), 15)
    assert [keyframe.image is not None for keyframe in keyframes] == [False] * 5 + [True] * 10
