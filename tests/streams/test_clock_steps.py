"""The machine's clock is set while the robot runs: by NTP at its first network, or where a battery was empty."""

from __future__ import annotations

from datetime import UTC, datetime
from types import SimpleNamespace

import pytest

from contextpolicy.policies import plan_publisher
from contextpolicy.streams import subscription, wall_clock
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.runner_rig import APPLIED, IMU, Robot
from tests.virtual_operator import START


@pytest.fixture
def robot(monkeypatch):
    """Its sensors stamp their samples with the wall clock, which is `robot.step` seconds off the loop's time."""
    robot = Robot(
        streams=[a_stream("imu", timestamp="stamp", staleAfter="500ms")],
        tasks=[a_task("slam"), a_task("speech")],
        contexts=[a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}}), a_context("blind")],
        fallback="blind",
    )
    wall = SimpleNamespace(time=lambda: now(robot) + robot.step, monotonic=lambda: now(robot))
    monkeypatch.setattr(subscription, "time", wall)
    monkeypatch.setattr(wall_clock, "time", wall)
    monkeypatch.setattr(plan_publisher, "time", wall)
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
def test_a_clock_step_drops_no_sample_and_ends_no_context(robot, step):
    assert drive(robot, 1) == {"moving"}
    robot.step = step
    assert drive(robot, 3) == {"moving"}
    assert not robot.runner.planner.drops


def test_a_delayed_sample_is_too_old_even_after_a_clock_step(robot):
    drive(robot, 1)
    robot.step = -3600.0
    drive(robot, 1)
    assert drive(robot, 1, lag=0.7) >= {"blind"}
    assert set(robot.runner.planner.drops) == {("imu", "out of order"), ("imu", "too old")}


@pytest.fixture
def forced(monkeypatch):
    """A context is forced for ten minutes of the wall clock, which is `step` seconds off when the policy starts."""

    def start(step):
        robot = Robot(contexts=[a_context("moving", "false")])
        robot.step = step
        wall = SimpleNamespace(time=lambda: now(robot) + robot.step, monotonic=lambda: now(robot))
        monkeypatch.setattr(subscription, "time", wall)
        monkeypatch.setattr(wall_clock, "time", wall)
        until = datetime.fromtimestamp(now(robot) + step + 600, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        robot.runner = robot.version(
            contexts=[a_context("moving", "false")], force={"context": "moving", "until": until}
        )
        robot.begin()
        robot.loop.advance_by(1)
        return robot

    return start


def is_forced(robot):
    return robot.runner.planner.last.contexts == ("moving",)


@pytest.mark.parametrize("step", [0.0, 3600.0, -3600.0])
def test_a_force_ends_by_the_wall_clock_of_its_start(forced, step):
    robot = forced(step)
    assert is_forced(robot)
    robot.loop.advance_by(597)
    assert is_forced(robot)
    robot.loop.advance_by(3)
    assert not is_forced(robot)


def test_a_force_whose_end_the_corrected_clock_has_passed_ends_within_a_second(forced):
    """An operator that started an hour behind would hold it for an hour too long."""
    robot = forced(0.0)
    robot.step = 3600.0
    robot.loop.advance_by(1.1)
    assert not is_forced(robot)


def test_a_clock_set_back_extends_a_force(forced):
    robot = forced(0.0)
    robot.step = -60.0
    robot.loop.advance_by(630)
    assert is_forced(robot)
    robot.loop.advance_by(31)
    assert not is_forced(robot)


def test_a_force_begins_after_a_fast_clock_is_set_back(forced):
    robot = forced(0.0)
    robot.step = 3600.0
    robot.loop.advance_by(120)
    assert not is_forced(robot)
    robot.step = 0.0
    robot.loop.advance_by(31)
    assert is_forced(robot)
    robot.loop.advance_by(600 - 120 - 31 + 1)
    assert not is_forced(robot)


def test_the_clock_is_checked_every_30_s_after_a_force(forced, monkeypatch):
    robot, looks, ahead = forced(0.0), [], wall_clock.ahead
    robot.loop.advance_by(700)

    def look(scheduler):
        looks.append(1)
        return ahead(scheduler)

    monkeypatch.setattr(wall_clock, "ahead", look)
    robot.loop.advance_by(60)
    assert len(looks) == 2


def test_displayed_times_follow_a_corrected_clock(robot):
    clock = wall_clock.WallClock(robot.loop, lambda: now(robot) + robot.step)
    robot.step = wall_clock.STEP / 2  # to read two clocks takes time
    assert clock.ahead == 0.0
    robot.step = -3600.0
    assert clock.ahead == pytest.approx(3600)
    assert clock.now() == pytest.approx(now(robot) - 3600)


@pytest.mark.parametrize("step", [3600.0, -3600.0])
def test_times_on_the_bus_follow_a_corrected_clock(robot, step):
    """An operator that started an hour behind must not date its plans an hour back until it restarts."""
    robot.step = step
    set_at = now(robot) + step
    drive(robot, 1)
    plan = robot.session.plans()[-1]
    assert plan["contexts"] == ["moving"]
    assert plan["time"] == pytest.approx(set_at, abs=1.1)
    assert plan["trigger"] == pytest.approx(set_at, abs=1.1)
    robot.runner.publisher.publish_applied("accepted", "lab/slam/slam", 0.8, now(robot))
    [applied] = [message for key, message in robot.session.published if key == APPLIED]
    assert applied["time"] == pytest.approx(now(robot) + step)
    explained = robot.runner.explain()
    assert explained["time"] == pytest.approx(now(robot) + step)
    assert explained["plan"]["time"] == pytest.approx(set_at, abs=1.1)
    assert explained["plan"]["age"] == pytest.approx(explained["time"] - explained["plan"]["time"])
