from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from modules.navigation.odometry import Pose, moved
from modules.navigation.waypoints import CRUISE, REACHED, Motion, Route

STEP = 0.05
COORDINATE = st.floats(-3, 3)


def driven(waypoints, pose):
    """Follow the route with perfect wheels and give the last pose and the time it took."""
    route = Route(waypoints)
    for step in range(round(240 / STEP)):
        motion = route.next_motion(pose)
        if motion is None:
            return pose, step * STEP
        left, right = motion.wheels()
        pose = moved(pose, left / 1000 * STEP, right / 1000 * STEP)
    raise AssertionError(f"{route.left} waypoints left at {pose}")


@settings(max_examples=50)
@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=4), st.floats(-math.pi, math.pi))
def test_every_route_is_driven_to_its_end(waypoints, heading):
    pose, _ = driven(waypoints, Pose(0, 0, heading))
    assert math.dist((pose.x, pose.y), waypoints[-1]) < REACHED


def test_straight_ahead_it_cruises():
    assert Route([(5, 0)]).next_motion(Pose()) == Motion(CRUISE, 0)


def test_it_turns_on_the_spot_to_a_waypoint_behind():
    motion = Route([(-1, 0.1)]).next_motion(Pose())
    assert motion is not None
    assert motion.forward == 0
    assert motion.turn > 0


def test_a_route_without_waypoints_is_done():
    assert Route([]).next_motion(Pose()) is None


def test_wheels_are_in_mm_per_s_left_first():
    assert Motion(0.2, 2.0).wheels() == (-35, 435)


@given(st.floats(-2, 2), st.floats(-10, 10))
def test_wheel_speeds_are_limited_without_changing_the_curve(forward, turn):
    left, right = Motion(forward, turn).wheels()
    assert max(abs(left), abs(right)) <= 500
    free = (forward - turn * 0.1175, forward + turn * 0.1175)
    assert left * free[1] == pytest.approx(right * free[0], abs=3)
