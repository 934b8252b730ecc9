from __future__ import annotations

import numpy as np
import pytest

from modules.slam.geometry import inverse, transform
from modules.slam.pose_graph import Edge, Kind, PoseGraph


def turn(degrees, *shift):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return transform(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array(shift or (0, 0, 0), float))


def ring(count, drift):
    """Keyframes around a circle, each step with the same error, and what odometry makes of them."""
    step = turn(360 / count, 1.0, 0, 0)
    truth, guessed = [np.eye(4)], [np.eye(4)]
    graph = PoseGraph()
    for number in range(1, count):
        truth.append(truth[-1] @ step)
        guessed.append(guessed[-1] @ step @ drift)
        graph.add(Edge(number - 1, number, step @ drift, 100))
    return graph, dict(enumerate(truth)), dict(enumerate(guessed))


def test_a_loop_spreads_the_drift_over_the_path():
    graph, truth, guessed = ring(24, turn(0.3, 0.01, 0.0, 0.002))
    before = np.linalg.norm(guessed[23][:3, 3] - truth[23][:3, 3])
    graph.add(Edge(0, 23, inverse(truth[0]) @ truth[23], 100, Kind.LOOP))
    fitted = graph.fitted(guessed, [0])
    assert fitted[0] == pytest.approx(np.eye(4), abs=1e-6)
    assert np.linalg.norm(fitted[23][:3, 3] - truth[23][:3, 3]) < before / 10
    worst = max(np.linalg.norm(fitted[number][:3, 3] - truth[number][:3, 3]) for number in truth)
    assert worst < before / 2


def test_consistent_poses_stay_and_have_no_residual():
    graph, truth, _ = ring(5, np.eye(4))
    assert graph.strain(truth) == pytest.approx(0, abs=1e-9)
    fitted = graph.fitted(truth, [0])
    assert all(fitted[number] == pytest.approx(truth[number], abs=1e-6) for number in truth)


def test_parts_that_are_not_connected_need_an_anchor_each():
    graph = PoseGraph()
    graph.add(Edge(0, 1, turn(0, 1, 0, 0), 100))
    graph.add(Edge(2, 3, turn(0, 2, 0, 0), 100))
    poses = {0: np.eye(4), 1: np.eye(4), 2: turn(0, 9, 9, 9), 3: np.eye(4)}
    fitted = graph.fitted(poses, [0, 2])
    assert fitted[1][:3, 3] == pytest.approx([1, 0, 0], abs=1e-6)
    assert fitted[3][:3, 3] == pytest.approx([11, 9, 9], abs=1e-6)


def test_near_keyframes_are_ordered_by_graph_distance():
    graph, *_ = ring(6, np.eye(4))
    assert graph.near(2, 3) == [2, 1, 3]
    assert graph.near(0, 100) == [0, 1, 2, 3, 4, 5]
    assert graph.near(77, 5) == [77]


def test_a_keyframe_is_taken_out_without_breaking_the_path():
    graph, truth, _ = ring(5, np.eye(4))
    graph.bypass(2)
    assert graph.near(0, 9) == [0, 1, 3, 4]
    del truth[2]
    assert graph.strain(truth) == pytest.approx(0, abs=1e-9)
    (joined,) = [edge for edge in graph._edges[3] if {edge.first, edge.second} == {1, 3}]
    assert joined.inliers == 50  # as uncertain as both edges together


def test_a_loop_can_be_removed():
    graph, truth, _ = ring(5, np.eye(4))
    loop = Edge(0, 4, np.eye(4), 100, Kind.LOOP)
    graph.add(loop)
    assert graph.strain(truth) > 1000
    graph.remove(loop)
    assert graph.strain(truth) == pytest.approx(0, abs=1e-9)
