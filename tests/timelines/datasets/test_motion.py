from __future__ import annotations

import numpy as np
import pytest

from timelines.datasets.motion import GRAVITY, Motion

MOTION = Motion(duration=6, moving=((1, 5),), speed=0.3)
TIMES = np.arange(0, 6, 0.005)


def test_a_robot_that_stands_feels_only_gravity():
    still = np.array([0.2, 0.5, 5.6])
    assert MOTION.gyro_at(still) == pytest.approx(np.zeros((3, 3)), abs=1e-9)
    assert MOTION.accelerations_at(still) == pytest.approx(np.tile(GRAVITY, (3, 1)), abs=1e-9)


def test_a_moving_robot_turns_and_rolls():
    moving = np.arange(1.6, 4.4, 0.1)
    assert MOTION.speed_at(moving) == pytest.approx(0.3)
    assert np.linalg.norm(MOTION.gyro_at(moving), axis=1).mean() > 0.05


def test_the_gyro_leads_to_the_orientation():
    turn = np.eye(3)
    for x, y, z in MOTION.gyro_at(TIMES) * 0.005:
        turn = turn @ (np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    assert turn == pytest.approx(MOTION.rotations_at(np.array([6.0]))[0], abs=0.01)


def test_the_accelerometer_leads_to_the_path():
    felt = np.einsum("nij,nj->ni", MOTION.rotations_at(TIMES), MOTION.accelerations_at(TIMES)) - GRAVITY
    path = np.cumsum(np.cumsum(felt, axis=0) * 0.005, axis=0) * 0.005
    assert path[-1] == pytest.approx(MOTION.positions_at(np.array([6.0]))[0], abs=0.02)


def test_a_course_leads_around_and_back():
    quarter = (np.pi / 4, np.pi / 2)  # a radius of half a metre
    motion = Motion(40, ((0.5, 12), (15, 38)), speed=0.3, course=((1, 0), quarter, (1, 0), quarter) * 2)
    yaw = motion.angles_at(np.array([0.0, 13, 39]))[0]
    assert yaw[0] == 0
    assert 0.5 < yaw[1] / np.pi < 2
    assert yaw[2] == pytest.approx(2 * np.pi)
    standing = np.array([12.5, 14.5])
    assert np.ptp(motion.positions_at(standing), axis=0) == pytest.approx(np.zeros(3))
    assert np.ptp(motion.angles_at(standing)[0]) == pytest.approx(0)
