"""What the operator tells about contexts and plans: Events with a bound, and a line of the log with each cause."""

from __future__ import annotations

import logging

from contextpolicy.telemetry.event_budget import BURST, FOR_PROBLEMS, REFILL
from tests.policies.builders import IMU, a_policy


def reasons(operator):
    return [reason for reason, _ in operator.told()]


def test_a_context_that_begins_and_ends_is_an_event(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.sample(IMU, speed=0.0)
    running.settle()
    assert running.told() == [
        ("ContextEntered", "moving: imu: context moving entered"),
        ("ContextExited", "moving: imu: context moving exited"),
    ]
    assert {event["type"] for event in running.cluster.events} == {"Normal"}


def test_an_edit_does_not_tell_again_what_holds(running):
    running.sample(IMU, speed=0.3)
    running.settle()
    running.apply(a_policy(generation=2, reserve="0"))
    running.settle()
    assert reasons(running) == ["ContextEntered"]


def test_a_flapping_context_posts_a_burst_and_then_says_what_it_left_out(running):
    for turn in range(2 * BURST):
        running.sample(IMU, speed=0.3 if turn % 2 == 0 else 0.0)
        running.turn(0.1)
    running.settle()
    posted = BURST - FOR_PROBLEMS
    assert len(running.told()) == posted
    running.turn(REFILL)
    running.sample(IMU, speed=0.3)
    running.settle()
    assert f"({2 * BURST - posted} earlier events were left out)" in running.told()[posted][1]


def test_the_log_has_each_plan_with_its_cause(running, caplog):
    with caplog.at_level(logging.INFO, logger="contextpolicy.telemetry.logs"):
        running.sample(IMU, speed=0.3)
    [record] = caplog.records
    assert record.getMessage() == "lab/robot: plan 2: imu: context moving entered -> slam=800m speech=200m"
    assert (record.policy, record.cause, record.contexts) == ("lab/robot", "imu: context moving entered", ["moving"])
    assert record.shares == {"slam": "800m", "speech": "200m"}
