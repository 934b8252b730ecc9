"""Which samples of a stream count, and when it is silent."""

from __future__ import annotations

import pytest

from contextpolicy.planning.conditions.absence import UNHEARD
from tests.planning.builders import a_stream
from tests.planning.conditions.watching import watching


def test_a_sample_is_a_value_until_the_next_one():
    story = watching(a_stream("imu"))
    story.sample("imu", at=1, speed=1.0)
    story.sample("imu", at=2, speed=0.0)
    assert story.contexts_over_time() == [(0, ()), (1, ("on",)), (2, ())]


def test_a_silent_stream_has_no_value():
    story = watching(a_stream("imu", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.wait(10)
    assert story.contexts_over_time() == [(0, ()), (0.1, ("on",)), (0.6, ())]
    assert story.last.cause == "imu: silent; imu: context on exited"


def test_a_stream_that_is_never_heard_is_silent_after_the_same_time():
    story = watching(a_stream("imu", staleAfter="2s"))
    story.wait(1.9)
    assert not story.planner.streams["imu"].silent
    story.wait(2)
    assert story.planner.streams["imu"].silent


def test_a_stream_without_a_sample_for_an_hour_is_unheard_until_the_next():
    story = watching(a_stream("imu"))
    story.sample("imu", at=1, speed=1.0)
    imu = story.planner.streams["imu"]
    for end, unheard in ((UNHEARD, False), (1 + UNHEARD, True)):
        story.wait(end)
        assert imu.unheard is unheard
    story.sample("imu", at=2 + UNHEARD, speed=1.0)
    assert not imu.unheard


def test_silence_is_dated_to_its_deadline_not_the_next_sample():
    story = watching(a_stream("imu", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.sample("imu", at=9, speed=1.0)
    assert story.contexts_over_time() == [(0, ()), (0.1, ("on",)), (0.6, ()), (9, ("on",))]


def test_a_lost_liveliness_token_does_not_wait_for_stale_after():
    story = watching(a_stream("imu", staleAfter="10s", liveliness="robot/imu/alive"))
    story.sample("imu", at=1, speed=1.0)
    story.gone("imu", at=2)
    assert story.contexts_over_time()[-1] == (2, ())
    story.wait(60)
    assert story.last.time == 1002.0


def test_a_lost_token_counts_once_without_stale_after():
    story = watching(a_stream("imu"))
    story.sample("imu", at=1, speed=1.0)
    story.gone("imu", at=2)
    story.gone("imu", at=3)
    story.gone("unheard-of", at=4)
    assert story.contexts_over_time() == [(0, ()), (1, ("on",)), (2, ())]


def test_a_sample_older_than_the_last_is_dropped():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=2.0, speed=1.0)
    story.sample("imu", at=2.1, stamp=1.9, speed=0.0)
    assert story.contexts_over_time()[-1] == (2, ("on",))
    assert story.drops() == {("imu", "out of order"): 1}


def test_two_samples_of_one_instant_both_count():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=2.0, speed=1.0)
    story.sample("imu", at=2.1, stamp=2.0, speed=0.0)
    assert story.contexts_over_time()[-1] == (2.1, ())


def test_a_clock_set_back_does_not_block_its_sender():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=20, stamp=20.0, speed=1.0)
    story.sample("imu", at=21, stamp=-500.0, speed=0.0)
    story.sample("imu", at=22, stamp=-499.0, speed=1.0)
    assert story.drops() == {}


def test_order_restarts_after_silence_or_a_lost_token():
    story = watching(a_stream("imu", timestamp="stamp", staleAfter="3s"))
    story.sample("imu", at=2, stamp=2.0, speed=1.0)
    story.wait(10)
    story.sample("imu", at=11, stamp=10.0, speed=1.0)
    story.gone("imu", at=11.5)
    story.sample("imu", at=12, stamp=9.9, speed=1.0)
    assert story.drops() == {}


def test_a_stale_sample_is_dropped_and_does_not_reset_staleness():
    story = watching(a_stream("imu", timestamp="stamp", staleAfter="500ms"))
    story.sample("imu", at=2, stamp=1.4, speed=1.0)
    assert story.drops() == {("imu", "too old"): 1}
    assert story.planner.streams["imu"].silent


@pytest.mark.parametrize("stamp", [3.1, 1e9, float("nan"), float("inf"), float("-inf")])
def test_an_invalid_timestamp_is_ignored_but_its_sample_counts(stamp):
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=stamp, speed=1.0)
    assert story.contexts_over_time()[-1] == (2, ("on",))
    assert story.drops() == {("imu", "timestamp ignored"): 1}


def test_a_clock_slightly_ahead_is_accepted():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=2.9, speed=1.0)
    story.sample("imu", at=2.5, stamp=2.8, speed=0.0)
    assert story.drops() == {("imu", "out of order"): 1}


def test_a_sample_that_cel_cannot_hold_is_dropped():
    story = watching(a_stream("imu"))
    story.sample("imu", at=1, speed="\ud800")
    story.sample("imu", at=2, speed=object())
    assert story.drops() == {("imu", "expression"): 2}
    assert story.planner.streams["imu"].value is None


def test_a_sample_of_an_undeclared_stream_is_counted():
    story = watching(a_stream("imu"))
    story.sample("lidar", at=1, near=1.0)
    assert story.drops() == {("lidar", "unknown stream"): 1}
