"""The machine's clock is set while the robot runs: by NTP at its first network, or where a battery was empty."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from contextpolicy.streams import subscription
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.runner_rig import IMU, Robot
from tests.virtual_operator import START


class SteppedRobot(Robot):
    step = 0.0


@pytest.fixture
def robot(monkeypatch):
    """Its sensors stamp their samples with the wall clock, which is `robot.step` seconds off the loop's time."""
    robot = SteppedRobot(
        streams=[a_stream("imu", timestamp="stamp", staleAfter="500ms")],
        tasks=[a_task("slam"), a_task("speech")],
        contexts=[a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}}), a_context("blind")],
        fallback="blind",
    )
    wall = SimpleNamespace(time=lambda: now(robot) + robot.step, monotonic=lambda: now(robot))
    monkeypatch.setattr(subscription, "time", wall)
    return robot.begin()


def now(robot):
    return robot.loop.to_seconds(robot.loop.now)


def drive(robot, seconds, *, lag=0.0):
    """Ten samples a second, each stamped `lag` before it arrives."""
    contexts = set()
    for _ in range(round(seconds * 10)):
        robot.loop.advance_by(0.1)
        robot.session.deliver(IMU, speed=0.3, stamp=now(robot) + robot.step - lag)
        robot.loop.advance_by(0.001)
        contexts |= set(robot.runner.planner.last.contexts)
    return contexts


@pytest.mark.parametrize("step", [3600.0, -3600.0, 5.0, -5.0, 50 * 365 * 86400.0, -START])
def test_a_clock_that_is_set_neither_drops_a_sample_nor_ends_a_context(robot, step):
    assert drive(robot, 1) == {"moving"}
    robot.step = step
    assert drive(robot, 3) == {"moving"}
    assert not robot.runner.planner.drops


def test_a_sample_that_was_long_under_way_is_too_old_before_and_after_a_step(robot):
    drive(robot, 1)
    robot.step = -3600.0
    drive(robot, 1)
    assert drive(robot, 1, lag=0.7) >= {"blind"}
    assert set(robot.runner.planner.drops) == {("imu", "out of order"), ("imu", "too old")}
