from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation.odometry import METRES_PER_COUNT, WHEEL_BASE, Odometry, Pose, counted, moved, wrapped


@given(st.integers(-32768, 32767), st.integers(-32768, 32767))
def test_a_difference_survives_the_roll_over(before, difference):
    after = (before + difference + 32768) % 65536 - 32768
    assert counted(before, after) == difference


def test_the_counter_rolls_over_at_about_14_and_a_half_metres():
    assert pytest.approx(14.5, abs=0.1) == 32768 * METRES_PER_COUNT


@given(st.integers(-32768, 32767), st.integers(1, 40))
def test_straight_ahead_for_any_distance_is_a_straight_line(start, steps):
    odometry = Odometry()
    for step in range(steps + 1):
        count = (start + step * 3000 + 32768) % 65536 - 32768
        odometry.update(count, count)
    assert odometry.pose.x == pytest.approx(steps * 3000 * METRES_PER_COUNT)
    assert (odometry.pose.y, odometry.pose.heading) == pytest.approx((0, 0))


def test_a_quarter_circle_ends_where_geometry_says():
    radius = 1.0
    quarter = math.pi / 2
    left, right = (radius - WHEEL_BASE / 2) * quarter, (radius + WHEEL_BASE / 2) * quarter
    pose = Pose()
    for _ in range(10):
        pose = moved(pose, left / 10, right / 10)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((1, 1, quarter))


def test_turning_on_the_spot_does_not_move_the_robot():
    pose = moved(Pose(), -0.1, 0.1)
    assert (pose.x, pose.y) == pytest.approx((0, 0))
    assert pose.heading == pytest.approx(0.2 / WHEEL_BASE)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_going_back_the_same_way_leads_to_the_start(left, right):
    pose = moved(moved(Pose(), left, right), -left, -right)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0, 0, 0), abs=1e-9)


@given(st.floats(-100, 100))
def test_an_angle_is_wrapped_to_half_a_turn(angle):
    assert abs(wrapped(angle)) <= math.pi
    assert math.cos(wrapped(angle)) == pytest.approx(math.cos(angle))


def test_a_robot_that_was_reset_does_not_jump():
    odometry = Odometry()
    odometry.update(20_000, 20_000)
    odometry.restart()
    assert odometry.update(0, 0) == Pose()
