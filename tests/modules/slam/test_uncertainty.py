from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.slam.geometry import floats, inverse, transform, twist
from modules.slam.uncertainty import carried, chained, stretched, turned


def pose(turn, shift):
    return transform(floats(cv2.Rodrigues(np.array(turn, float))[0]), np.array(shift, float))


def small(error):
    """The shift and the turn of a small movement."""
    return np.concatenate([error[:3, 3], cv2.Rodrigues(error[:3, :3])[0].ravel()])


def spread(errors):
    return np.cov(np.array([small(error) for error in errors]).T)


FIRST, BETWEEN = pose((0.1, -0.4, 0.8), (1, 2, 3)), pose((0.3, 0.2, -1.2), (0.5, -2, 1))
COVARIANCE = np.diag([1, 2, 3, 0.5, 0.7, 0.9]) * 1e-6
DRAWS = np.random.default_rng(1).multivariate_normal(np.zeros(6), COVARIANCE, 4000)


def test_carried_covariance_matches_sampling():
    moved = [inverse(BETWEEN) @ twist(draw) @ BETWEEN for draw in DRAWS]
    assert carried(COVARIANCE, inverse(BETWEEN)) == pytest.approx(spread(moved), rel=0.1, abs=2e-7)


def test_uncertainty_adds_up_along_a_chain():
    other = np.random.default_rng(2).permutation(DRAWS)
    ends = [FIRST @ twist(draw) @ BETWEEN @ twist(second) for draw, second in zip(DRAWS, other, strict=True)]
    errors = [inverse(FIRST @ BETWEEN) @ end for end in ends]
    assert chained(COVARIANCE, COVARIANCE, BETWEEN) == pytest.approx(spread(errors), rel=0.1, abs=3e-7)


def test_covariance_rotates_into_the_world_frame():
    left = pose((0, 0, np.pi / 2), (5, 5, 5))
    upright = turned(np.diag([4.0, 0, 0, 0, 1, 0]), left)
    assert np.diag(upright) == pytest.approx([0, 4, 0, 1, 0, 0])


def test_an_unsure_scale_moves_a_pose_along_its_direction_from_the_start():
    place = np.array([30.0, 40, 0])
    scales = np.random.default_rng(3).normal(1, 0.02, 4000)
    sampled = np.cov((scales[:, None] * place).T)
    assert stretched(np.zeros((6, 6)), place, 0.02)[:3, :3] == pytest.approx(sampled, rel=0.1, abs=1e-9)
    assert stretched(COVARIANCE, np.zeros(3), 0.02) == pytest.approx(COVARIANCE)
