"""Processors are slowed all the time, or a run does not count."""

from __future__ import annotations

import time

import pytest

from tests.waiting import until
from timelines.experiments import slowed as slowed_module
from timelines.experiments.capacity import Capacity
from timelines.experiments.slowed import SlowedError, check, slowed


def thief(monkeypatch, tmp_path, program):
    path = tmp_path / "thief.py"
    path.write_text(program, encoding="utf-8")
    monkeypatch.setattr(slowed_module, "__file__", str(path))


BEGINS = "print('begins', flush=True)"


def test_nothing_runs_where_no_thief_begins(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, "raise SystemExit(1)")
    with pytest.raises(SlowedError, match="realtime priorities"), slowed(0.5, {0}):
        pytest.fail("it began")


def test_a_thief_that_has_ended_is_an_error(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, BEGINS)
    with pytest.raises(SlowedError, match="has ended"):
        slow_down_again_and_again(20)


def slow_down_again_and_again(seconds):
    """It is found out in the end only, and a program takes a while to end."""
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        with slowed(0.5, {0}):
            time.sleep(0.2)


def test_thieves_end_with_what_they_slow(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, f"import time; {BEGINS}; time.sleep(60)")
    began = time.monotonic()
    with slowed(0.5, {0, 1}):
        pass
    assert time.monotonic() - began < 30


def test_whole_processors_need_none(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, "raise SystemExit(1)")
    with slowed(1.0, {0}):
        time.sleep(0.1)


def test_what_thieves_take_is_counted_by_their_own_clocks(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, f"{BEGINS}\nwhile True: pass")
    with slowed(0.5, {0}) as thieves:
        before = thieves.seconds()
        until(lambda: thieves.seconds() > before)


@pytest.mark.parametrize(
    ("taken", "processors", "part", "seconds"),
    [(9.1, 1, 0.5, 20.0), (0.0, 2, 1.0, 20.0), (0.9, 1, 0.98, 30.0), (50.5, 1, 0.15, 60.0), (24.0, 2, 0.75, 60.0)],
)
def test_processors_may_be_a_little_more_or_less_slow(taken, processors, part, seconds):
    """The least that a thief takes of each period is more than it should, where it should take next to nothing."""
    check(taken, Capacity(processors, part), seconds)


@pytest.mark.parametrize(
    ("taken", "processors", "part", "seconds"),
    [(8.9, 1, 0.5, 20.0), (11.1, 1, 0.5, 20.0), (47.0, 1, 0.15, 60.0), (0.0, 1, 0.8, 20.0)],
)
def test_processors_whose_load_is_another_than_it_should_be_are_an_error(taken, processors, part, seconds):
    """A load follows from what is left: with a part of 0.15, a tenth too little taken makes it a third less."""
    with pytest.raises(SlowedError, match=rf"took {taken:.2f} s of them instead of"):
        check(taken, Capacity(processors, part), seconds)
