"""What earlier runs tell: the speed that limits count on, and a run whose processors did more than their pace."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import ABOUT, SCHEDULE, a_run, at_speed
from timelines.experiments.capacity import WHOLE, Capacity
from timelines.experiments.earlier import FEW, LATEST, Earlier, Kind
from timelines.experiments.machine import kind
from timelines.experiments.metrics import Run

ONE, TWO = Capacity(1, 0.4), Capacity(2, 0.4)
HERE = kind(ABOUT["machine"])


def run(configuration="linux", speed=1.0, **more):
    about = {name: more.pop(name) for name in ("capacity", "machine", "date") if name in more}
    record = at_speed(a_run(configuration, **more), speed)
    return Run(SCHEDULE, replace(record, about={**record.about, **about}))


def expected(earlier, capacity=ONE, *, limited=False):
    return earlier.expected(Kind(HERE, capacity, limited)) / WHOLE


def test_a_processor_is_expected_to_be_as_fast_as_in_most_of_the_latest_runs():
    """One slow run was disturbed; two are what the host does now."""
    earlier = Earlier(run(speed=speed) for speed in (1.9, 1.2, 1.6))
    assert expected(earlier) == pytest.approx(1.6)
    for _ in range(LATEST):
        earlier.add(run(speed=2.0))
    assert expected(earlier) == pytest.approx(2.0)


def test_what_comes_next_follows_attempts_that_do_not_count_as_well():
    earlier = Earlier(run(speed=2.0) for _ in range(LATEST))
    for _ in range(2):
        earlier.note_speed(run(speed=0.9).record)
    assert expected(earlier) == pytest.approx(0.9)


def test_two_processors_at_once_are_not_as_fast_as_one():
    earlier = Earlier()
    assert expected(earlier) == 1.0
    earlier.add(run(speed=2.0))
    assert expected(earlier, TWO) == pytest.approx(2.0)
    earlier.add(run(speed=1.5, capacity=list(TWO)))
    assert expected(earlier, ONE) == pytest.approx(2.0)
    assert expected(earlier, TWO) == pytest.approx(1.5)


def test_processors_that_limits_leave_idle_are_expected_to_be_as_slow_as_such_ones_were():
    earlier = Earlier([run(speed=2.0), run("limits-gated", speed=1.6)])
    assert expected(earlier) == pytest.approx(2.0)
    assert expected(earlier, limited=True) == pytest.approx(1.6)


def test_what_another_machine_did_says_nothing():
    there = {**ABOUT["machine"], "kernel": "another"}
    earlier = Earlier([run(speed=2.0, machine=there)])
    assert expected(earlier) == 1.0


def test_runs_count_in_the_order_of_their_dates():
    days = {f"2026-11-{day:02}": speed for day, speed in ((29, 2.0), *((day, 1.0) for day in range(1, 1 + LATEST)))}
    latest = Earlier(run(speed=speed, date=date) for date, speed in days.items())
    assert expected(latest) == pytest.approx(1.0)
    assert latest._speeds[Kind(HERE, ONE, limited=False)][-1] == 2.0 * WHOLE


def earlier_of_usual_work():
    return Earlier([run("alone"), *(run(cpu=cost) for cost in (0.026, 0.025, 0.025, 0.024, 0.025))])


def test_a_run_whose_inputs_took_less_work_had_faster_processors_than_their_pace():
    """As measured: the loop was slowed by a neighbour and the tasks were not, so they had a quarter more."""
    (reason,) = earlier_of_usual_work().reasons(run("static", cpu=0.019))
    assert reason == "the same inputs took 76% of other runs' work: expected 88% to 112%"
    (reason,) = earlier_of_usual_work().reasons(run("static", cpu=0.03))
    assert "120%" in reason


def test_work_is_that_of_processors_of_any_speed():
    assert list(earlier_of_usual_work().reasons(run(cpu=0.0125, speed=2.0))) == []
    assert list(earlier_of_usual_work().reasons(run(cpu=0.025, speed=2.0))) != []


def test_configurations_differ_a_little_in_their_work():
    for cost in (0.0225, 0.0275):
        assert list(earlier_of_usual_work().reasons(run("static", cpu=cost))) == []


def test_under_limits_work_is_compared_with_that_under_limits():
    """They take a tenth less of it: beside all others they would be repeated more often than these."""
    earlier = earlier_of_usual_work()
    assert list(earlier.reasons(run("limits", cpu=0.0215))) == []
    for _ in range(FEW):
        earlier.add(run("limits-gated", cpu=0.0225))
    assert list(earlier.reasons(run("limits", cpu=0.0205))) == []
    assert list(earlier.reasons(run("static", cpu=0.0205))) != []


def test_modules_that_adapt_do_less_when_they_are_late_and_are_compared_with_such():
    earlier = earlier_of_usual_work()
    assert list(earlier.reasons(run("weights-adaptive", cpu=0.015))) == []
    for _ in range(FEW):
        earlier.add(run("linux-adaptive", cpu=0.015))
    assert list(earlier.reasons(run("weights-adaptive", cpu=0.02))) != []
    assert list(earlier.reasons(run("static", cpu=0.025))) == []


def test_a_task_alone_takes_less_work_and_is_no_reason():
    earlier = earlier_of_usual_work()
    assert list(earlier.reasons(run("alone", cpu=0.015))) == []


def test_what_the_same_inputs_take_on_another_machine_says_nothing():
    other = {**ABOUT["machine"], "kernel": "7"}
    earlier = Earlier(run(machine=other) for _ in range(FEW))
    assert list(earlier.reasons(run(cpu=0.015))) == []
    assert list(earlier.reasons(run(cpu=0.015, machine=other))) != []


def test_few_runs_do_not_say_what_is_usual():
    earlier = Earlier([run("alone"), *(run(cpu=0.025) for _ in range(FEW - 1))])
    assert list(earlier.reasons(run(cpu=0.015))) == []
    assert list(earlier.reasons(run(cpu=0.015, load="light"))) == []


def test_a_run_that_did_nothing_of_the_same_is_not_judged():
    assert list(earlier_of_usual_work().reasons(run("static", slam="d" * 10, speech="d" * 10))) == []
