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
    count = 0
    while current != goal:
        before, current, count = current, stepped(ARM, current, goal), count + 1
        left = {name for name in NAMES if current[name] != pytest.approx(goal[name], abs=1e-9)}
        assert not left or left >= {name for name in NAMES if abs(goal[name] - before[name]) > 1e-6} - {""}
        assert count <= 180 / (45 * STEP_S) + 1
    assert stepped(ARM, current, goal) == goal
