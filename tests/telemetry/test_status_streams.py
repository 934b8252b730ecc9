"""What the status says of streams: silent, never heard, dropped samples, other clocks."""

from __future__ import annotations

import pytest

from contextpolicy.planning.inputs import Gone
from contextpolicy.telemetry.api_text import timestamp
from tests.planning.builders import START, Story, a_context, a_stream
from tests.telemetry.made_status import a_robot, condition, made, moving


def test_a_silent_stream():
    story = moving()
    story.wait(5)
    content = made(story)
    assert condition(content, "StreamsHealthy") == (
        "False",
        "Silent",
        f"stream imu (robot/imu) is silent: last sample at {timestamp(START + 1)}",
    )
    assert content["streams"][0]["healthy"] is False


def test_a_stream_that_was_never_heard():
    story = Story(a_robot())
    story.take(Gone("imu"), at=0.5)
    assert condition(made(story), "StreamsHealthy")[2] == "stream imu (robot/imu) is silent: no sample yet"


def test_dropped_samples_are_counted_by_reason():
    story = moving()
    for reason in ("undecodable", "undecodable", "overrun"):
        story.planner.on_drop("imu", reason)
    assert made(story)["streams"] == [{"name": "imu", "healthy": True, "message": "overrun: 1; undecodable: 2"}]


def test_an_expression_that_fails():
    story = Story(a_robot())
    story.sample("imu", at=1, speed="fast")
    state, reason, message = condition(made(story), "StreamsHealthy")
    assert (state, reason) == ("False", "ExpressionFailed")
    assert message.startswith("imu.speed > 0.1: ")


def test_an_hour_of_silence_is_reported_without_stale_after():
    story = Story(a_robot(streams=[a_stream("imu"), a_stream("mic")]))
    health = []
    story.on_each_health(lambda: health.append(condition(made(story), "StreamsHealthy")))
    story.sample("imu", at=1, speed=0.3)
    story.sample("imu", at=1800, speed=0.3)
    story.wait(3600)
    assert health[-1] == ("False", "Silent", "stream mic (robot/mic) had no sample for 1 h: no sample yet")
    story.wait(5399)
    assert len(health) == 2
    story.wait(5400)
    reported = f"stream imu (robot/imu) had no sample for 1 h: last sample at {timestamp(START + 1800)}"
    assert health[-1][2].startswith(reported)
    assert story.planner.active_contexts(), "its last value still counts"
    story.sample("imu", at=5401, speed=0.3)
    assert [stream["healthy"] for stream in made(story)["streams"]] == [True, False]
    assert len(health) == 4


def test_it_is_reported_which_stream_a_condition_waits_for_and_since_when():
    story = moving(
        streams=[a_stream("imu", staleAfter="1s"), a_stream("button")],
        contexts=[a_context("alarm", "imu.speed > 9 || button.pressed", {"speech": {"suspend": True}})],
    )
    health = []
    story.on_each_health(lambda: health.append(made(story)["streams"]))
    reported = f"context alarm has been waiting since {timestamp(START)}: button has no value"
    assert [stream["message"] for stream in made(story)["streams"]] == ["", reported]
    assert condition(made(story), "StreamsHealthy")[0] == "True"
    story.sample("button", at=1.5, pressed=False)
    assert len(health) == 1
    assert [stream["message"] for stream in made(story)["streams"]] == ["", ""]


@pytest.mark.parametrize(
    ("offset", "off"),
    [
        (-20.0, "20 s behind"),
        (-7200.0, "2 h behind"),
        (-3 * 86400.0, "3 days behind"),
        (-1.8e9, "57 years behind"),
        (7200.0, "2 h ahead of"),
    ],
)
def test_a_stream_says_when_its_timestamps_are_of_another_clock(offset, off):
    story = Story(a_robot())
    for tick in range(20):
        story.sample("imu", at=tick / 10, stamp=tick / 10 + offset, speed=0.3)
    [stream] = made(story)["streams"]
    reported = (
        f"its timestamps are from another clock, {off} ours (simulated time, a replay?): the time of arrival counts"
    )
    assert stream["message"].partition("; ")[0] == reported
    assert stream["healthy"]
