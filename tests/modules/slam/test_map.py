from __future__ import annotations

import numpy as np
import pytest

from modules.slam.features import Features
from modules.slam.geometry import transform
from modules.slam.map import Map
from modules.slam.pose_graph import Edge, Kind
from modules.slam.tracking import Fix


def at(x, y=0.0):
    return transform(np.eye(3), np.array([x, y, 0.0]))


def add(known, pose, seen_from=None, between=None, inliers=100):
    features = Features(np.zeros((3, 2)), np.zeros((3, 32), np.uint8))
    points = np.array([[0, 0, 2.0], [1, 0, 3.0], [np.nan] * 3])
    fixes = [] if seen_from is None else [Fix(seen_from, between, inliers)]
    return known.add(pose, features, points, fixes)


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
def test_a_loop_joins_what_came_after_the_camera_was_lost(newer_first):
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


def test_beside_are_the_connected_keyframes_with_the_most_similar_view():
    known = Map(30)
    keyframes = row(known, 6)
    assert [keyframe.number for keyframe in known.beside(keyframes[3], at(3.8), 2)] == [4, 5]
