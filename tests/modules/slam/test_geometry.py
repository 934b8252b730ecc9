from __future__ import annotations

import numpy as np
import pytest

from modules.slam.geometry import angle, apply, inverse, moved, quaternion, rotations, transform

HALF = np.sqrt(0.5)
QUARTER = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        (np.eye(3), (0, 0, 0, 1)),
        (QUARTER, (0, 0, HALF, HALF)),
        (np.diag([1.0, -1.0, -1.0]), (1, 0, 0, 0)),
    ],
)
def test_quaternion(rotation, expected):
    assert quaternion(rotation) == pytest.approx(expected, abs=1e-9)
    assert rotations(3 * np.array([expected]))[0] == pytest.approx(rotation, abs=1e-9)


def test_transforms_chain():
    step = transform(np.eye(3), np.array([1.0, 2.0, 3.0]))
    assert (step @ step @ np.array([0, 0, 0, 1])).tolist() == [2, 4, 6, 1]


def test_an_inverse_leads_back_for_one_and_for_many():
    there = transform(QUARTER, np.array([1.0, 2.0, 3.0]))
    assert inverse(there) @ there == pytest.approx(np.eye(4))
    assert inverse(np.stack([there, np.eye(4)])) == pytest.approx(np.stack([np.linalg.inv(there), np.eye(4)]))


def test_points_are_turned_then_shifted():
    assert apply(transform(QUARTER, np.array([0, 0, 1.0])), np.array([[1.0, 0, 0]])).tolist() == [[0, 1, 1]]


def test_angle_and_distance_of_a_transform():
    assert angle(transform(QUARTER, np.zeros(3))) == pytest.approx(np.pi / 2)
    assert angle(np.eye(4)) == 0
    assert moved(transform(QUARTER, np.array([3.0, 4, 0]))) == 5
