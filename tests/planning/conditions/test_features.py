"""Numbers over a window of samples, and readings that are no finite number."""

from __future__ import annotations

import pytest

from tests.planning.builders import START, Story, a_policy, a_stream, a_task
from tests.planning.conditions.watching import watching


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


def test_readers_are_evaluated_only_when_a_feature_changes():
    feature = {"name": "top", "op": "max", "of": "imu.speed", "over": "1s"}
    story = watching(a_stream("imu", features=[feature]), "imu.top > 0.5")
    asked = []
    story.planner.contexts[0].on_value = lambda now, **_: asked.append(round(now - START, 6))
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
def test_an_empty_window_has_only_count_and_rate(op, when):
    story = watching(a_stream("imu", features=[{"name": "f", "op": op, "of": "imu.speed", "over": "1s"}]), when)
    story.sample("imu", at=1, speed=1.0)
    story.wait(5)
    assert story.contexts_over_time() == [(0, ()), (2, ("on",))]


def test_an_empty_window_makes_the_condition_wait_without_an_error():
    story = watching(
        a_stream("imu", features=[{"name": "f", "op": "max", "of": "imu.speed", "over": "1s"}]), "imu.f > 0"
    )
    story.sample("imu", at=1, speed=1.0)
    story.wait(5)
    waiting = story.planner.contexts[0].when.waiting
    assert (waiting.stream, waiting.reason, waiting.since) == ("imu", "imu.f has no sample in its window", START + 2)
    assert not story.planner.errors
    assert not story.drops()


def test_the_window_of_a_silent_stream_sets_no_timer():
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
def test_non_finite_samples_do_not_corrupt_features(numbers, features):
    """Infinity means nothing in range and NaN unknown; neither outlasts the window."""
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
