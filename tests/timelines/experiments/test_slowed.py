"""Processors keep their pace all the time, or a run does not count."""

from __future__ import annotations

import time

import pytest

from tests.waiting import until
from timelines.experiments import thief as thief_module
from timelines.experiments.slowed import SlowedError, left_by, slowed, speed
from timelines.experiments.thief import LEAST, PERIOD, Pacer

PACE = 100_000.0


def pacer_after(*speeds, periods=200):
    """One that saw a processor of these speeds, for so many periods each; the parts of them that it has left."""
    pacer, left = Pacer(PACE), []
    for speed_now in speeds:
        for _ in range(periods):
            seconds = pacer.take()
            pacer.took(round(speed_now * seconds), seconds, PERIOD - seconds)
        left.append(pacer.line(periods * PERIOD))
    return left


def test_a_faster_processor_does_as_much_for_all_else():
    (slow, fast), (_, again) = pacer_after(1.2 * PACE, 2.4 * PACE), pacer_after(2.4 * PACE, 1.2 * PACE)
    assert slow[1] == pytest.approx(PACE, rel=0.05)
    assert fast[1] == pytest.approx(PACE, rel=0.05)
    assert again[1] == pytest.approx(PACE, rel=0.05)
    assert slow[0] > 1.8 * fast[0]


def test_of_a_processor_that_is_too_slow_nearly_all_is_left():
    ((seconds, turns),) = pacer_after(0.5 * PACE)
    assert seconds == pytest.approx(1 - LEAST)
    assert turns == pytest.approx(0.5 * PACE * (1 - LEAST), rel=0.2)


def test_time_in_which_the_host_ran_something_else_was_left_to_nobody():
    pacer = Pacer(PACE)
    for _ in range(200):
        pacer.took(round(1.2 * PACE * 0.0005), 0.0005, 0.001)  # of five milliseconds
    assert pacer.line(200 * PERIOD)[0] == pytest.approx(0.2)


def test_lines_come_to_a_speed_and_to_the_part_of_the_pace_that_was_left():
    assert left_by([(0.5, 100_000), (0.25, 90_000), (0.5, 106_000)], PACE) == (236_800, 0.987, 0.9)


def test_thieves_that_say_nothing_are_an_error():
    with pytest.raises(SlowedError, match="said nothing"):
        left_by([], PACE)


def thief(monkeypatch, tmp_path, program):
    path = tmp_path / "thief.py"
    path.write_text(program, encoding="utf-8")
    monkeypatch.setattr(thief_module, "__file__", str(path))


BEGINS = "print('begins', flush=True)"


def test_nothing_runs_where_no_thief_begins(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, "raise SystemExit(1)")
    with pytest.raises(SlowedError, match="realtime priorities"), slowed(PACE, {0}):
        pytest.fail("it began")


def test_a_thief_that_has_ended_is_an_error(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, BEGINS)
    with pytest.raises(SlowedError, match="has ended"):
        slow_down_again_and_again(20)


def slow_down_again_and_again(seconds):
    """It is found out in the end only, and a program takes a while to end."""
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        with slowed(PACE, {0}):
            time.sleep(0.2)


def test_thieves_end_with_what_they_slow(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, f"import time; {BEGINS}; time.sleep(60)")
    began = time.monotonic()
    with slowed(PACE, {0, 1}):
        pass
    assert time.monotonic() - began < 30


def test_what_thieves_take_is_counted_by_their_own_clocks(monkeypatch, tmp_path):
    thief(monkeypatch, tmp_path, f"{BEGINS}\nwhile True: pass")
    with slowed(PACE, {0}) as thieves:
        before = thieves.seconds()
        until(lambda: thieves.seconds() > before)


def test_a_thief_takes_most_where_little_is_to_be_left_and_says_so():
    pace = 0.05 * speed(0)
    with slowed(pace, {0}) as thieves:
        until(lambda: thieves.seconds() > 1.5)
    kept = thieves.pace()
    assert 0 < kept.worst <= kept.left < 4  # 19, if it took LEAST
    assert kept.speed > pace
