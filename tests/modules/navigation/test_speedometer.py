from __future__ import annotations

import pytest

from modules.navigation.odometry import METRES_PER_COUNT, WHEEL_BASE, Odometry
from modules.navigation.speedometer import Speedometer
from modules.navigation.task import Navigation
from modules.navigation.waypoints import STILL, Motion


def driven(odometry, left, right, seconds):
    """Count what wheels at these speeds, in mm/s, run."""
    counts = (round(speed / 1000 * seconds / METRES_PER_COUNT) for speed in (left, right))
    odometry.update(*(before + count for before, count in zip(odometry._last, counts, strict=True)))


@pytest.fixture
def odometry():
    standing = Odometry()
    standing.update(0, 0)
    return standing


def test_speeds_are_those_of_the_wheels(odometry):
    speedometer = Speedometer(odometry)
    speedometer.read(10.0)
    driven(odometry, left=100, right=300, seconds=0.2)
    motion = speedometer.read(10.2)
    assert (motion.forward, motion.turn) == pytest.approx((0.2, 0.2 / WHEEL_BASE), abs=0.02)


def test_wheels_at_their_limit_are_slower_than_the_order(odometry):
    speedometer = Speedometer(odometry)
    speedometer.read(0.0)
    left, right = Motion(0.5, 4.0).wheels()
    driven(odometry, left, right, seconds=1)
    motion = speedometer.read(1.0)
    assert (motion.forward, motion.turn) == pytest.approx((0.258, 2.06), abs=0.01)


def test_backward_and_clockwise_are_negative(odometry):
    speedometer = Speedometer(odometry)
    speedometer.read(0.0)
    driven(odometry, left=-100, right=-200, seconds=1)
    motion = speedometer.read(1.0)
    assert motion.forward < 0
    assert motion.turn < 0


def test_what_was_read_does_not_count_again(odometry):
    speedometer = Speedometer(odometry)
    driven(odometry, left=200, right=200, seconds=1)
    speedometer.read(1.0)
    assert speedometer.read(1.2) == STILL


def test_odometry_of_a_robot_that_stands_has_no_speed_whatever_its_order():
    navigation = Navigation("/dev/nowhere")
    navigation._moving = Motion(0.5, 4.0)
    navigation._speedometer.read(0.0)
    where = navigation._where(0.2)
    assert (where["forward"], where["turn"]) == (0, 0)
