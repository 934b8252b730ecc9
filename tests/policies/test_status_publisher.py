"""What the operator reports about contexts and plans: Events with a bound, and a line of the log with each cause."""

from __future__ import annotations

import logging
from datetime import datetime

import pytest

from contextpolicy.telemetry.api_text import timestamp
from contextpolicy.telemetry.event_budget import BURST, FOR_PROBLEMS, REFILL
from contextpolicy.telemetry.reporter import STATUS_INTERVAL
from tests.policies.builders import IMU, a_policy


def reasons(operator):
    return [reason for reason, _ in operator.reported()]


def test_a_context_that_begins_and_ends_is_an_event(running):
    running.react(IMU, speed=0.3)
    running.react(IMU, speed=0.0)
    assert running.reported() == [
        ("ContextEntered", "moving: imu: context moving entered"),
        ("ContextExited", "moving: imu: context moving exited"),
    ]
    assert {event["type"] for event in running.cluster.events} == {"Normal"}


def test_an_edit_does_not_repeat_events_of_active_contexts(running):
    running.react(IMU, speed=0.3)
    running.apply(a_policy(generation=2, reserve="0"))
    running.settle()
    assert reasons(running) == ["ContextEntered"]


def test_a_flapping_context_posts_a_burst_and_then_says_what_it_left_out(running):
    for turn in range(2 * BURST):
        running.sample(IMU, speed=0.3 if turn % 2 == 0 else 0.0)
        running.turn(0.1)
    running.settle()
    posted = BURST - FOR_PROBLEMS
    assert len(running.reported()) == posted
    running.turn(REFILL)
    running.react(IMU, speed=0.3)
    assert f"({2 * BURST - posted} earlier events were left out)" in running.reported()[posted][1]


def test_the_log_has_each_plan_with_its_cause(running, caplog):
    with caplog.at_level(logging.INFO, logger="contextpolicy.telemetry.logs"):
        running.sample(IMU, speed=0.3)
    [record] = caplog.records
    assert record.getMessage() == "lab/robot: plan 3: imu: context moving entered -> slam=800m speech=200m"
    assert record.fields == {
        "policy": "lab/robot",
        "sequence": 3,
        "cause": "imu: context moving entered",
        "contexts": ["moving"],
        "shares": {"slam": "800m", "speech": "200m"},
    }


@pytest.mark.parametrize("step", [3600.0, -3600.0])
def test_times_follow_a_corrected_clock(running, step):
    """An operator that started before the first network time must not date its plans an hour back until it restarts."""
    running.step = step
    moved = running.wall_time()
    running.react(IMU, speed=0.3)
    running.turn(STATUS_INTERVAL)
    posted = running.cluster.events[-1]
    assert posted["firstTimestamp"] == posted["lastTimestamp"] == timestamp(moved)
    assert running.cluster.statuses["lab/robot"]["plan"]["time"] == timestamp(moved)


def test_conditions_and_silence_are_dated_by_the_corrected_clock(running):
    heard = running.wall_time()
    running.step = 3600.0
    running.turn(11)
    status, reason, message = running.condition("StreamsHealthy")
    assert (status, reason) == ("False", "Silent")
    assert f"last sample at {timestamp(heard + 3600)}" in message
    [changed] = [
        one["lastTransitionTime"]
        for one in running.cluster.statuses["lab/robot"]["conditions"]
        if one["type"] == "StreamsHealthy"
    ]
    assert abs(_seconds(changed) - running.wall_time()) < 5


def _seconds(reported):
    return datetime.fromisoformat(reported).timestamp()
