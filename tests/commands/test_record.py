"""The robot of a recording; tests/commands/test_on_the_cluster.py has the command."""

from __future__ import annotations

import pytest

from contextpolicy.bus.plan_message import message
from contextpolicy.commands.record import robot_of
from tests.planning.builders import Story, a_policy, a_task, on_node


@pytest.mark.parametrize("scheduler", ["CFS", "Realtime"])
def test_replay_divides_the_recorded_capacity(scheduler):
    tasks = [a_task("slam", priority=3), a_task("speech")]
    policy = a_policy(tasks=tasks, enforcement={"scheduler": scheduler}, reserve="100m")
    recorded = Story(policy, on_node("slam", "speech", cores=4))
    robot = robot_of(message(policy, 1, recorded.last, (), (), {}), policy.reserve)
    assert Story(policy, robot.placement(policy)).shares() == recorded.shares()
