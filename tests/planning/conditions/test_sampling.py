"""Samples that are held back, passed now and then, or filtered."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from contextpolicy.policy import parsing
from tests.planning.builders import Story, a_stream
from tests.planning.conditions.watching import watching

LISTING_1 = Path(__file__).parents[3] / "config/policies/paper-listing1.yaml"


def test_debounce_passes_the_newest_after_a_quiet_period():
    story = watching(a_stream("imu", debounce="100ms"))
    for at, speed in ((1.0, 1.0), (1.05, 0.0), (1.1, 2.0)):
        story.sample("imu", at=at, speed=speed)
    story.wait(5)
    assert story.contexts_over_time() == [(0, ()), (1.2, ("on",))]
    assert story.planner.streams["imu"].value == {"speed": 2.0}


def test_sample_every_passes_the_first_at_once_and_then_the_newest():
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
    assert story.contexts_over_time() == [(0, ())]


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
    assert story.contexts_over_time() == [(0, ()), (0.5, ("on",))]


@pytest.mark.parametrize("sample", [{}, {"ok": 1}, {"ok": "yes"}, {"ok": None}])
def test_a_filter_without_an_answer_drops_the_sample(sample):
    story = watching(a_stream("imu", filter="imu.ok"))
    story.sample("imu", at=1, **sample)
    assert story.drops() == {("imu", "expression"): 1}


def test_a_filtered_sample_renews_stale_after_but_not_the_age():
    story = watching(a_stream("imu", filter="imu.ok", staleAfter="1s"), "age(imu) > 2", fallback="on")
    for at in range(6):
        story.sample("imu", at=at, ok=at == 0)
    assert not story.planner.streams["imu"].silent
    assert story.contexts_over_time() == [(0, ()), (2, ("on",))]
    story.wait(6)
    assert story.planner.streams["imu"].silent


def test_a_sample_dropped_for_its_timestamp_renews_neither():
    story = watching(a_stream("imu", clock="Source", staleAfter="3s"), "age(imu) > 2")
    for at in range(3):
        story.sample("imu", at=at, stamp=0 if at == 0 else -9)
    story.wait(2.5)
    assert story.contexts_over_time() == [(0, ()), (2, ("on",))]
    story.wait(3)
    assert story.planner.streams["imu"].silent


def test_an_age_counts_from_when_a_sample_held_back_counts():
    story = watching(a_stream("imu", sampleEvery="1s"), "age(imu) > 2")
    for at in (0.0, 0.1, 0.2):
        story.sample("imu", at=at, speed=at)
    story.wait(10)
    assert story.contexts_over_time() == [(0, ()), (3, ("on",))]
