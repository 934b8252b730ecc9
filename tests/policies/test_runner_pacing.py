"""Weights and scores that move no share are published all the same, at a bounded rate."""

from __future__ import annotations

import pytest
from prometheus_client import REGISTRY

from contextpolicy.policies.pipeline import UPDATE_INTERVAL
from tests.planning.builders import a_task
from tests.policies.runner_rig import PLAN, Robot


def robot_with_a_fixed_share():
    tasks = [a_task("slam", max="600m", min="600m", activity=[{"scoreFrom": "imu.speed"}]), a_task("speech")]
    robot = Robot(tasks=tasks, contexts=[]).begin()
    robot.loop.advance_by(10)
    return robot


def shown(robot):
    return [
        (message["sequence"], message["edition"], message["tasks"]["slam"]["weight"])
        for message in robot.session.plans()
    ]


def test_updates_are_reported_but_order_nothing():
    robot = robot_with_a_fixed_share()
    robot.sample(speed=0.3)
    robot.loop.advance_by(10)
    ordered, sequence = len(robot.orders.all), robot.session.plans()[-1]["sequence"]
    robot.changes = 0
    robot.sample(speed=0.5)
    assert shown(robot)[-1] == (sequence, 1, 0.5)
    assert robot.session.plans()[-1]["cause"] == "imu: true is 0.5"
    assert len(robot.orders.all) == ordered
    assert robot.changes
    labels = {"namespace": "lab", "name": "robot", "task": "slam"}
    assert REGISTRY.get_sample_value("contextpolicy_task_weight", labels) == 0.5


def test_a_flutter_is_reported_at_a_bounded_rate_and_its_end_always():
    robot = robot_with_a_fixed_share()
    robot.sample(speed=0.3)
    before = len(robot.session.plans())
    robot.changes = 0
    for tick in range(300):  # three seconds at 100 Hz
        robot.sample(speed=0.3 + tick / 1000)
    robot.loop.advance_by(10)
    reported = shown(robot)[before:]
    assert len(reported) <= 3 / UPDATE_INTERVAL + 2
    assert reported[-1][2] == pytest.approx(0.599)
    assert [edition for _, edition, _ in reported] == list(range(1, len(reported) + 1))
    assert robot.changes == len(reported)


def test_no_message_without_a_change():
    robot = robot_with_a_fixed_share()
    robot.sample(speed=0.3)
    robot.loop.advance_by(10)
    before = len(robot.session.plans())
    for _ in range(100):
        robot.sample(speed=0.3)
    robot.loop.advance_by(10)
    assert len(robot.session.plans()) == before


def test_queries_are_answered_with_current_values():
    robot = robot_with_a_fixed_share()
    for speed in (0.3, 0.4, 0.5):
        robot.sample(speed=speed)
    plan, why = robot.session.ask(PLAN), robot.session.ask("contextpolicy/lab/robot/explain")
    robot.loop.advance_by(0.01)
    assert plan.answers[0]["tasks"]["slam"]["weight"] == 0.5
    assert why.answers[0]["tasks"]["slam"]["weight"] == 0.5
    assert why.answers[0]["plan"]["cause"] == "imu: true is 0.3"


def test_a_stopped_runner_reports_nothing_more():
    robot = robot_with_a_fixed_share()
    for speed in (0.3, 0.4, 0.5):
        robot.sample(speed=speed)
    robot.runner.stop()
    before = len(robot.session.plans())
    robot.loop.advance_by(10)
    assert len(robot.session.plans()) == before
