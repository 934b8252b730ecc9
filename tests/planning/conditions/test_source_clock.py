"""Streams whose timestamps are of another clock: simulated time, a recording that is played again."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.planning.conditions.source_clock import EVIDENCE, EVIDENCE_TIME
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

SIMULATED = -START
"""What has to be added to our time to get the time of a simulation that begins with the story."""
HOUR = 3600.0
PERIOD = 0.1


def listening(**stream):
    """`on` holds while the newest sample that counts has an odd number; `busy` while four or more come a second."""
    rate = {"name": "rate", "op": "rate", "over": "1s"}
    spec = {"timestamp": "stamp", "staleAfter": "500ms", "features": [rate], **stream}
    return Story(
        a_policy(
            streams=[a_stream("imu", **spec)],
            tasks=[a_task("slam")],
            contexts=[a_context("on", "imu.number % 2 == 1"), a_context("busy", "imu.rate >= 4.0")],
        )
    )


def play(story, numbers, *, offset, speed=1.0, begin=0.0):
    """Samples at 10 Hz, each stamped by a clock that was `offset` off at `begin` and runs at `speed`."""
    heard = []
    for index, number in enumerate(numbers):
        elapsed = index * PERIOD
        stream = story.planner.streams["imu"]
        stream.value = None
        story.sample("imu", at=begin + elapsed, stamp=begin + offset + elapsed * speed, number=number)
        heard.append(stream.value is not None)
    return heard


@pytest.mark.parametrize("offset", [SIMULATED, -20.0, -HOUR, HOUR, 20.0])
@pytest.mark.parametrize("speed", [1.0, 1.1])
def test_samples_of_another_clock_count_from_their_arrival(offset, speed):
    story = listening()
    heard = play(story, range(40), offset=offset, speed=speed)
    assert all(heard[round(EVIDENCE_TIME / PERIOD) + 1 :])
    assert story.planner.streams["imu"].clock.behind == pytest.approx(-offset, abs=0.5)
    assert "busy" in story.last.contexts
    assert not story.planner.streams["imu"].silent


@pytest.mark.parametrize("clock", ["Auto", "Source"])
def test_age_and_silence_count_from_arrival_by_any_clock(clock):
    stream = a_stream("imu", timestamp="stamp", staleAfter="500ms", clock=clock)
    late, silent = a_context("late", "age(imu) > 0.3"), a_context("silent", "!heard(imu)")
    story = Story(a_policy(streams=[stream], tasks=[a_task("slam")], contexts=[late, silent]))
    story.sample("imu", at=1, stamp=0.6)
    assert story.contexts_over_time()[-1][1] == ()
    story.wait(3)
    (since, first), (until, second) = story.contexts_over_time()[-2:]
    assert [since, until] == pytest.approx([1.3, 1.5])
    assert (first, second) == (("late",), ("late", "silent"))


@pytest.mark.parametrize("speed", [0.1, 2.0, 10.0])
def test_a_recording_of_yesterday_may_be_played_at_any_speed(speed):
    story = listening()
    assert all(play(story, range(40), offset=-24 * HOUR, speed=speed)[12:])


def test_an_unset_stamp_counts_as_another_clock():
    """Drivers leave `header.stamp` at 0."""
    story = listening()
    assert all(play(story, range(40), offset=SIMULATED, speed=0.0)[12:])


def test_late_samples_alone_do_not_indicate_another_clock():
    story = listening()
    play(story, range(20), offset=0.0)
    for at in (2.0, 2.3, 2.6, 2.9, 3.2, 3.5, 3.8):
        story.sample("imu", at=at, stamp=at - 15.0, number=1)
        story.sample("imu", at=at + 0.1, stamp=at + 0.1, number=0)
    assert story.planner.streams["imu"].clock.behind is None
    assert story.drops()["imu", "too old"] == 7


def test_a_burst_of_old_samples_does_not_indicate_another_clock():
    """A late subscriber receives cached samples."""
    story = listening()
    for index in range(EVIDENCE * 4):
        story.sample("imu", at=1 + index / 1000, stamp=-HOUR + index, number=1)
    assert story.planner.streams["imu"].clock.behind is None
    assert story.drops() == {("imu", "too old"): EVIDENCE * 4}


@pytest.mark.parametrize("speed", [1.5, 3.0, 20.0])
def test_a_shrinking_backlog_is_too_old_but_not_another_clock(speed):
    story = listening()
    heard = play(story, range(300), offset=-25.0, speed=speed)
    assert story.planner.streams["imu"].clock.behind is None
    ages = [25.0 - index * PERIOD * (speed - 1) for index in range(300)]
    assert not any(fresh for fresh, age in zip(heard, ages, strict=True) if age > 0.51)


def test_a_clock_that_gets_synchronised_is_accepted_at_once():
    """NTP has set it: from here on a late sample is a late one."""
    story = listening()
    play(story, range(30), offset=-HOUR)
    assert play(story, range(5), offset=-0.1, begin=3.0) == [True] * 5
    story.sample("imu", at=3.6, stamp=2.0, number=1)
    assert story.drops()["imu", "out of order"] == 1
    assert story.planner.streams["imu"].clock.behind is None


@pytest.mark.parametrize("length", [2.0, 8.0, 30.0])
def test_a_recording_that_begins_again_continues(length):
    story = listening()
    count = round(length / PERIOD)
    play(story, range(count), offset=-HOUR)
    heard = play(story, range(40), offset=-HOUR - length, begin=length)
    assert all(heard[round(EVIDENCE_TIME / PERIOD) + 1 :])


def test_the_clock_field_overrides_detection():
    """`Source`: our clock, whatever it says. `Arrival`: timestamps count for nothing."""
    source, arrival = listening(clock="Source"), listening(clock="Arrival")
    assert not any(play(source, range(40), offset=-HOUR))
    assert source.drops() == {("imu", "too old"): 40}
    assert all(play(arrival, range(40), offset=-HOUR))
    arrival.sample("imu", at=4.0, stamp=-2 * HOUR, number=1)
    assert arrival.drops() == {}


def test_the_status_is_notified_once_per_clock_change():
    reported = []
    story = listening(staleAfter=None)
    story.on_each_health(lambda: reported.append(story.planner.streams["imu"].clock.behind))
    play(story, range(40), offset=-HOUR)
    play(story, range(40), offset=0.0, begin=4.0)
    heard, *changes = reported
    assert (heard, changes) == (None, [pytest.approx(HOUR), None])


def test_an_edit_elsewhere_in_the_policy_keeps_the_clock():
    story = listening()
    play(story, range(30), offset=-HOUR)
    edited = listening()
    edited.planner.start(START + 3.0, story.planner)
    assert edited.planner.streams["imu"].clock.behind == pytest.approx(HOUR)


late = st.lists(st.integers(0, 8), min_size=60, max_size=60)


@given(overtaken=late, offset=st.sampled_from([SIMULATED, -HOUR, 40.0, 1e9]))
def test_order_and_rates_do_not_depend_on_the_clock(overtaken, offset):
    """Each sample may be overtaken by some; which ones count must not depend on whose clock stamps them."""
    lead_in = 2.0
    ours, other = listening(staleAfter="20s"), listening(staleAfter="20s")
    outcomes = []
    for story, off in ((ours, 0.0), (other, offset)):
        play(story, range(round(lead_in / PERIOD)), offset=off)
        before = story.drops().get(("imu", "out of order"), 0)
        states = []
        for index, back in enumerate(overtaken):
            at = lead_in + index * PERIOD
            story.sample("imu", at=at, stamp=at + off - (back > 5) * back * PERIOD, number=index)
            imu = story.planner.streams["imu"]
            states.append((imu.value["number"], imu.features(START + at)["rate"]))
        outcomes.append((states, story.drops().get(("imu", "out of order"), 0) - before))
    assert outcomes[0] == outcomes[1]
