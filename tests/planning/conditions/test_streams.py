"""Which samples of a stream count, and what the expressions see of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from contextpolicy.policy import parsing
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

LISTING_1 = Path(__file__).parents[3] / "config/policies/paper-listing1.yaml"


def watching(stream, when="imu.speed > 0.0", **fields):
    """One stream and one context over it, so that `contexts_over_time` tells what the stream's readers saw."""
    spec = {"streams": [stream], "tasks": [a_task("slam")], "contexts": [a_context("on", when)]}
    return Story(a_policy(**spec, **fields))


def test_a_sample_is_a_value_until_the_next_one():
    story = watching(a_stream("imu"))
    story.sample("imu", at=1, speed=1.0)
    story.sample("imu", at=2, speed=0.0)
    assert story.contexts_over_time() == [(0, ()), (1, ("on",)), (2, ())]


def test_a_silent_stream_is_no_value():
    story = watching(a_stream("imu", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.wait(10)
    assert story.contexts_over_time() == [(0.1, ("on",)), (0.6, ())]
    assert story.last.cause == "imu: context on exited; imu: silent"


def test_a_stream_that_is_never_heard_is_silent_after_the_same_time():
    story = watching(a_stream("imu", staleAfter="2s"))
    story.wait(10)
    assert story.planner.streams["imu"].silent
    assert story.last.time == 1002.0


def test_a_silent_stream_is_heard_again():
    story = watching(a_stream("imu", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.wait(5)
    story.sample("imu", at=6, speed=1.0)
    assert story.contexts_over_time()[-1] == (6, ("on",))
    assert "imu: heard again" in story.last.cause
    assert not story.planner.streams["imu"].silent


def test_a_late_input_first_lets_the_watchdog_bark_at_its_own_instant():
    story = watching(a_stream("imu", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.sample("imu", at=9, speed=1.0)
    assert story.contexts_over_time() == [(0.1, ("on",)), (0.6, ()), (9, ("on",))]


def test_a_lost_liveliness_token_does_not_wait_for_stale_after():
    story = watching(a_stream("imu", staleAfter="10s", liveliness="robot/imu/alive"))
    story.sample("imu", at=1, speed=1.0)
    story.gone("imu", at=2)
    assert story.contexts_over_time()[-1] == (2, ())
    story.wait(60)
    assert story.last.time == 1002.0


def test_a_lost_token_counts_without_stale_after_too_and_twice_is_once():
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


def test_a_clock_set_back_does_not_lock_its_sender_out():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=20, stamp=20.0, speed=1.0)
    story.sample("imu", at=21, stamp=-500.0, speed=0.0)
    story.sample("imu", at=22, stamp=-499.0, speed=1.0)
    assert story.drops() == {}


def test_a_sender_that_was_silent_starts_a_new_order():
    story = watching(a_stream("imu", timestamp="stamp", staleAfter="3s"))
    story.sample("imu", at=2, stamp=2.0, speed=1.0)
    story.wait(10)
    story.sample("imu", at=11, stamp=10.0, speed=1.0)
    story.gone("imu", at=11.5)
    story.sample("imu", at=12, stamp=9.9, speed=1.0)
    assert story.drops() == {}


def test_a_sample_older_than_stale_after_is_dropped_and_does_not_feed_the_watchdog():
    story = watching(a_stream("imu", timestamp="stamp", staleAfter="500ms"))
    story.sample("imu", at=2, stamp=1.4, speed=1.0)
    assert story.drops() == {("imu", "too old"): 1}
    assert story.planner.streams["imu"].silent


@pytest.mark.parametrize("stamp", [3.1, 1e9, float("nan"), float("inf"), float("-inf")])
def test_a_timestamp_that_makes_no_sense_is_ignored_but_its_sample_counts(stamp):
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=stamp, speed=1.0)
    assert story.contexts_over_time()[-1] == (2, ("on",))
    assert story.drops() == {("imu", "timestamp ignored"): 1}


def test_a_clock_slightly_ahead_is_believed():
    story = watching(a_stream("imu", timestamp="stamp"))
    story.sample("imu", at=2, stamp=2.9, speed=1.0)
    story.sample("imu", at=2.5, stamp=2.8, speed=0.0)
    assert story.drops() == {("imu", "out of order"): 1}


def test_debounce_waits_for_rest_and_passes_the_newest():
    story = watching(a_stream("imu", debounce="100ms"))
    for at, speed in ((1.0, 1.0), (1.05, 0.0), (1.1, 2.0)):
        story.sample("imu", at=at, speed=speed)
    story.wait(5)
    assert story.contexts_over_time() == [(0, ()), (1.2, ("on",))]
    assert story.planner.streams["imu"].value == {"speed": 2.0}


def test_sample_every_passes_the_first_at_once_and_the_newest_when_its_time_has_come():
    story = watching(a_stream("imu", sampleEvery="1s"))
    for at, speed in ((1.0, 1.0), (1.2, 2.0), (1.4, 0.0)):
        story.sample("imu", at=at, speed=speed)
    assert story.planner.streams["imu"].value == {"speed": 1.0}
    story.wait(1.999)
    assert story.contexts_over_time()[-1] == (1, ("on",))
    story.wait(2.0)
    assert story.contexts_over_time()[-1] == (2, ())


def test_sample_every_after_a_pause_passes_at_once():
    story = watching(a_stream("imu", sampleEvery="1s"))
    story.sample("imu", at=1, speed=1.0)
    story.sample("imu", at=3, speed=0.0)
    assert story.contexts_over_time()[-1] == (3, ())


def test_a_sample_held_back_is_not_delivered_after_its_stream_fell_silent():
    story = watching(a_stream("imu", debounce="2s", staleAfter="500ms"))
    story.sample("imu", at=0.1, speed=1.0)
    story.wait(10)
    assert not story.planner.streams["imu"].fresh
    assert story.contexts_over_time() == [(0.1, ())]


def test_a_sample_held_back_is_not_delivered_after_its_sender_is_gone():
    story = watching(a_stream("imu", sampleEvery="1s"))
    story.sample("imu", at=1, speed=1.0)
    story.sample("imu", at=1.1, speed=1.0)
    story.gone("imu", at=1.5)
    story.wait(10)
    assert story.contexts_over_time()[-1] == (1.5, ())


def test_listing_1_of_the_paper_is_one_line_of_policy():
    policy = parsing.parse(yaml.safe_load(LISTING_1.read_text()))
    story = Story(policy)
    story.sample("imu", at=1, accelerometer={"x": 0.1, "y": 0.0, "z": 9.8})
    assert story.drops() == {("imu", "filtered"): 1}
    assert story.planner.streams["imu"].value is None
    story.sample("imu", at=2, accelerometer={"x": 0.1, "y": 0.2, "z": 9.8})
    assert story.shares()["slam"] > story.planner.policy.tasks[0].min
    story.wait(10)
    assert story.last.time == 1003.0


def test_a_filtered_sample_feeds_the_watchdog_but_changes_nothing():
    story = watching(a_stream("imu", filter="imu.ok", staleAfter="1s"))
    story.sample("imu", at=0.5, ok=True, speed=1.0)
    story.sample("imu", at=1.4, ok=False, speed=0.0)
    story.wait(2)
    assert story.contexts_over_time() == [(0.5, ("on",))]


@pytest.mark.parametrize("sample", [{}, {"ok": 1}, {"ok": "yes"}, {"ok": None}])
def test_a_filter_without_an_answer_drops_the_sample(sample):
    story = watching(a_stream("imu", filter="imu.ok"))
    story.sample("imu", at=1, **sample)
    assert story.drops() == {("imu", "expression"): 1}


@pytest.mark.parametrize(
    ("op", "expected"),
    [("mean", 2.0), ("min", 1.0), ("max", 3.0), ("count", 2.0), ("rate", 4.0)],
)
def test_features_are_computed_over_their_window(op, expected):
    feature = {"name": "f", "op": op, "of": "imu.speed", "over": "500ms"}
    story = watching(a_stream("imu", features=[feature]), f"imu.f == {expected}")
    story.sample("imu", at=0.4, speed=100.0)
    story.sample("imu", at=0.9, speed=1.0)
    story.sample("imu", at=1.0, speed=3.0)
    assert story.planner.streams["imu"].features(1001.0) == {"f": expected}
    assert story.last.contexts == ("on",)


def test_features_without_samples_are_null_or_zero():
    features = [{"name": op, "op": op, "of": "imu.speed", "over": "1s"} for op in ("mean", "min", "max", "rate")]
    story = watching(a_stream("imu", features=features))
    story.sample("imu", at=1, speed=1.0)
    assert story.planner.streams["imu"].features(1002.0) == {"mean": None, "min": None, "max": None, "rate": 0.0}


def test_a_feature_is_told_when_its_last_sample_left_the_window():
    feature = {"name": "bumps", "op": "count", "over": "1s"}
    story = watching(a_stream("imu", features=[feature]), "imu.bumps > 0.0")
    story.sample("imu", at=1, speed=1.0)
    story.wait(5)
    assert story.contexts_over_time() == [(0, ()), (1, ("on",)), (2, ())]


def test_a_window_slides_with_time():
    feature = {"name": "bumps", "op": "count", "over": "1s"}
    story = Story(
        a_policy(
            streams=[a_stream("imu", features=[feature])],
            tasks=[a_task("slam", activity=[{"scoreFrom": "imu.bumps"}], idle=0)],
        )
    )
    for at in (0.1, 0.2, 0.9):
        story.sample("imu", at=at, speed=1.0)
    seen = {}
    while (due := story.next_decision()) is not None:
        story.wait(due - START)
        seen[round(due - START, 6)] = story.planner.scores()["slam"]
    assert seen == {1.1: 2.0, 1.2: 1.0, 1.9: 0.0}


def test_readers_are_asked_only_when_a_feature_changes():
    feature = {"name": "top", "op": "max", "of": "imu.speed", "over": "1s"}
    story = watching(a_stream("imu", features=[feature]), "imu.top > 0.5")
    asked = []
    story.planner.contexts[0].on_value = lambda now: asked.append(round(now - START, 6))
    for at, speed in ((0.1, 0.0), (0.2, 0.0), (0.4, 1.0), (0.5, 0.0)):
        story.sample("imu", at=at, speed=speed)
    asked.clear()
    story.wait(9)
    assert asked == [1.4, 1.5]


@pytest.mark.parametrize(
    ("op", "when"),
    [
        *((op, f"imu.f == 0 && {when}") for op in ("count", "rate") for when in ("has(imu.f)", "imu.speed == 1")),
        *((op, "!has(imu.f) && imu.speed == 1") for op in ("mean", "min", "max")),
    ],
)
def test_an_empty_window_has_count_and_rate_and_nothing_else(op, when):
    story = watching(a_stream("imu", features=[{"name": "f", "op": op, "of": "imu.speed", "over": "1s"}]), when)
    story.sample("imu", at=1, speed=1.0)
    story.wait(5)
    assert story.contexts_over_time() == [(0, ()), (2, ("on",))]


def test_an_empty_window_is_waited_for_and_is_no_error():
    story = watching(
        a_stream("imu", features=[{"name": "f", "op": "max", "of": "imu.speed", "over": "1s"}]), "imu.f > 0"
    )
    story.sample("imu", at=1, speed=1.0)
    story.wait(5)
    waiting = story.planner.contexts[0].when.waiting
    assert (waiting.stream, waiting.reason, waiting.since) == ("imu", "imu.f has no sample in its window", START + 2)
    assert not story.planner.errors
    assert not story.drops()


def test_a_silent_streams_window_waits_for_nothing():
    stream = a_stream("imu", staleAfter="1s", features=[{"name": "f", "op": "count", "over": "1m"}])
    story = watching(stream, "imu.f > 1")
    story.sample("imu", at=1, speed=1.0)
    story.wait(3)
    assert story.next_decision() is None
    story.sample("imu", at=30, speed=1.0)
    assert story.last.contexts == ("on",)


def test_a_window_outlives_a_flood_and_huge_numbers():
    feature = {"name": "f", "op": "mean", "of": "imu.speed", "over": "1s"}
    story = watching(a_stream("imu", features=[feature]))
    story.sample("imu", at=1, speed=1e308)
    story.sample("imu", at=1.1, speed=1e308)
    for tick in range(12_000):
        story.sample("imu", at=3 + tick / 1e5, speed=1.0)
    assert story.planner.streams["imu"].features(1003.12) == {"f": 1.0}


def test_a_sample_that_a_feature_cannot_read_is_dropped_whole():
    feature = {"name": "f", "op": "mean", "of": "imu.speed", "over": "1s"}
    story = watching(a_stream("imu", features=[feature]))
    for speed in ("fast", None, True):
        story.sample("imu", at=1, speed=speed)
    assert story.drops() == {("imu", "expression"): 3}


INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("numbers", "features"),
    [
        ([INF, 3.0, 1.0], {"mean": INF, "min": 1.0, "max": INF, "rate": 3.0, "count": 3.0}),
        ([-INF, 3.0], {"mean": -INF, "min": -INF, "max": 3.0, "rate": 2.0, "count": 2.0}),
        ([INF, -INF], {"mean": None, "min": -INF, "max": INF, "rate": 2.0, "count": 2.0}),
        ([NAN, 3.0, NAN, 1.0, NAN], {"mean": 2.0, "min": 1.0, "max": 3.0, "rate": 5.0, "count": 5.0}),
        ([NAN], {"mean": None, "min": None, "max": None, "rate": 1.0, "count": 1.0}),
    ],
)
def test_a_lidar_that_sees_nothing_leaves_the_features_what_they_are(numbers, features):
    """Infinity is nothing in range, and NaN unknown; both leave the window as they came."""
    specs = [{"name": op, "op": op, "of": "scan.near", "over": "1s"} for op in features]
    story = watching(a_stream("scan", features=specs), "scan.min < 2.0")
    for number in numbers:
        story.sample("scan", at=1, near=number)
    scan = story.planner.streams["scan"]
    assert scan.features(START + 1) == features
    assert not [reason for stream, reason in story.drops() if stream == "scan"]
    assert bool(story.planner.active_contexts()) is (features["min"] is not None and features["min"] < 2.0)
    story.sample("scan", at=5, near=4.0)
    assert scan.features(START + 5) == {"mean": 4.0, "min": 4.0, "max": 4.0, "rate": 1.0, "count": 1.0}


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
