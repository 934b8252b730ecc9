from __future__ import annotations

import pytest
from hypothesis import given

from modules.arm.joints import NAMES
from modules.arm.kinematics import Unreachable
from modules.arm.motion import STEP_S, stepped
from tests.modules.arm.test_joints import ARM, POSTURES

MOST_STEPS = 200
"""The longest way, 180 degrees at 60 degrees/s, has 60; a forearm that must be raised takes longer."""


def allowed(posture):
    try:
        return bool(ARM.checked(posture))
    except Unreachable:
        return False


ALLOWED = POSTURES.filter(allowed)


def way(current, goal):
    """All postures from one to another."""
    postures = [current]
    while postures[-1] != goal:
        assert len(postures) < MOST_STEPS
        postures.append(stepped(ARM, postures[-1], goal))
    return postures


@given(POSTURES, POSTURES)
def test_no_step_is_faster_than_its_joint_may_be(current, goal):
    step = stepped(ARM, current, goal)
    for name in NAMES:
        assert abs(step[name] - current[name]) <= ARM.joints[name].speed * STEP_S + 1e-9


@given(ALLOWED, ALLOWED)
def test_steps_lead_to_the_goal_within_every_limit(current, goal):
    for posture in way(current, goal):
        ARM.checked(posture)


@pytest.mark.parametrize(("start", "end"), [((146, 0, -60), (200, 0, -60)), ((200, 0, -60), (150, 40, -60))])
def test_between_two_points_on_the_deck_the_grip_stays_on_it(start, end):
    postures = way(ARM.posture_at(start, grip=0), ARM.posture_at(end, grip=0))
    assert min(ARM.grip_at(posture)[2] for posture in postures) == pytest.approx(ARM.lowest)


def test_an_arm_that_was_left_below_the_deck_is_raised_first():
    below = {"base": 0.0, "shoulder": 0.0, "elbow": -80.0, "grip": 0.0}
    first = stepped(ARM, below, ARM.posture_at(ARM.home, grip=0))
    assert first == {**below, "elbow": -80.0 + ARM.joints["elbow"].speed * STEP_S}


@given(ALLOWED, ALLOWED)
def test_all_joints_arrive_together_unless_the_forearm_is_raised(current, goal):
    first = stepped(ARM, current, goal)
    ways = {name: goal[name] - current[name] for name in NAMES if abs(goal[name] - current[name]) > 0.01}
    parts = {name: (first[name] - current[name]) / length for name, length in ways.items()}
    if ARM.grip_at(first)[2] <= ARM.lowest + 1e-9:
        parts.pop("elbow", None)
    assert list(parts.values()) == pytest.approx(list(parts.values())[:1] * len(parts))
