from __future__ import annotations

import pytest
from hypothesis import given

from modules.arm.joints import NAMES
from modules.arm.motion import STEP_S, stepped
from tests.modules.arm.test_joints import ARM, POSTURES


@given(POSTURES, POSTURES)
def test_no_step_is_faster_than_its_joint_may_be(current, goal):
    step = stepped(ARM, current, goal)
    for name in NAMES:
        assert abs(step[name] - current[name]) <= ARM.joints[name].speed * STEP_S + 1e-9


@given(POSTURES, POSTURES)
def test_steps_lead_to_the_goal_and_all_joints_arrive_together(current, goal):
    first = stepped(ARM, current, goal)
    ways = {name: goal[name] - current[name] for name in NAMES if abs(goal[name] - current[name]) > 0.01}
    parts = [(first[name] - current[name]) / way for name, way in ways.items()]
    assert parts == pytest.approx(parts[:1] * len(parts))
    for _ in range(100):  # the longest way, 180 degrees at 60 degrees/s, has 60 steps
        current = stepped(ARM, current, goal)
    assert current == goal
