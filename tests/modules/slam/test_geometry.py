from __future__ import annotations

import numpy as np
import pytest

from modules.slam.geometry import quaternion, transform

HALF = np.sqrt(0.5)


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        (np.eye(3), (0, 0, 0, 1)),
        (np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), (0, 0, HALF, HALF)),
        (np.diag([1.0, -1.0, -1.0]), (1, 0, 0, 0)),
    ],
)
def test_quaternion(rotation, expected):
    assert quaternion(rotation) == pytest.approx(expected, abs=1e-9)


def test_transforms_chain():
    step = transform(np.eye(3), np.array([1.0, 2.0, 3.0]))
    assert (step @ step @ np.array([0, 0, 0, 1])).tolist() == [2, 4, 6, 1]
