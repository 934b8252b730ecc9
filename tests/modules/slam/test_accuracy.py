from __future__ import annotations

import numpy as np
import pytest

from modules.slam.geometry import transform
from tests.modules.slam.accuracy import align, trajectory_rmse

PATH = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 3], [4, 2, 3]], dtype=float)
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])


def test_a_turned_and_shifted_copy_has_no_error():
    assert trajectory_rmse(PATH @ TURN.T + (5, 6, 7), PATH) == pytest.approx(0, abs=1e-9)


def test_alignment_finds_the_transform():
    shift = np.array([5.0, 6.0, 7.0])
    assert align(PATH, PATH @ TURN.T + shift) == pytest.approx(transform(TURN, shift))


def test_a_mirrored_copy_is_not_the_same_path():
    assert trajectory_rmse(PATH * (1, 1, -1), PATH) > 0.1


def test_scale_is_not_forgiven():
    assert trajectory_rmse(PATH * 1.1, PATH) > 0.1
