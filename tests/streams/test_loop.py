from __future__ import annotations

import logging
import time
import weakref
from datetime import UTC, datetime, timedelta
from threading import Event, current_thread
from types import SimpleNamespace

import pytest
from reactivex.disposable import SerialDisposable

from contextpolicy.streams import loop as module
from contextpolicy.streams.loop import FEW, Loop, on_loop
from tests.waiting import PATIENCE


def settle(loop):
    """Return when everything scheduled so far has had its turn."""
    done = Event()
    loop.schedule(lambda *_: done.set())
    assert done.wait(PATIENCE)


def test_actions_run_in_order_on_one_thread(loop):
    seen = []
    for n in range(100):
        loop.schedule(lambda *_, n=n: seen.append((n, current_thread().name)))
    settle(loop)
    assert seen == [(n, "loop") for n in range(100)]


def test_timers_act_by_the_order_of_their_deadlines(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    loop, seen, done = Loop(), [], Event()

    def last(*_):
        seen.append("late")
        done.set()

    loop.schedule_relative(0.02, last)
    loop.schedule_relative(0.01, lambda *_: seen.append("early"))
    loop.schedule(lambda *_: seen.append("now"))
    clock[0] += 1.0
    assert done.wait(PATIENCE)
    loop.dispose()
    assert seen == ["now", "early", "late"]


def test_a_failing_action_is_logged_and_others_still_run(loop, caplog):
    seen = []

    def fail(*_):
        raise ValueError("by accident")

    with caplog.at_level(logging.ERROR):
        loop.schedule(fail)
        loop.schedule_relative(0.0, fail)
        loop.schedule(lambda *_: seen.append("still here"))
        settle(loop)
    assert seen == ["still here"]
    assert [str(record.exc_info[1]) for record in caplog.records] == ["by accident", "by accident"]


def test_its_clock_follows_the_monotonic_clock_from_the_wall_clocks_time(monkeypatch):
    monotonic = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: monotonic[0])
    loop = Loop()
    began = loop.now
    assert abs(began - datetime.now(UTC)) < timedelta(seconds=1)
    monotonic[0] += 12.5
    assert loop.now - began == timedelta(seconds=12.5)
    assert loop.to_seconds(loop.now) - loop.to_seconds(began) == 12.5


def test_a_disposed_loop_refuses_actions(loop):
    loop.dispose()
    with pytest.raises(RuntimeError, match="the loop has ended"):
        loop.schedule(lambda *_: None)


class Reminder:
    """An action that a test can see go."""

    def __call__(self, *_):
        pass


@pytest.mark.parametrize("on_thread", [lambda _, act: act(), lambda loop, act: on_loop(loop, act).result(PATIENCE)])
def test_a_far_timer_that_is_set_again_and_again_waits_once(loop, on_thread):
    kept: weakref.WeakSet[Reminder] = weakref.WeakSet()
    timer = SerialDisposable()

    def set_again():
        kept.add(reminder := Reminder())
        timer.disposable = loop.schedule_relative(3600, reminder)

    for _ in range(20 * FEW):
        on_thread(loop, set_again)
    settle(loop)
    assert 1 <= len(kept) <= 2 * FEW


def test_cancelled_timers_are_freed_after_a_burst(loop):
    kept: weakref.WeakSet[Reminder] = weakref.WeakSet()
    crowd = [loop.schedule_relative(3600, Reminder()) for _ in range(20 * FEW)]
    for timer in crowd:
        timer.dispose()
    for _ in range(60 * FEW):
        kept.add(reminder := Reminder())
        loop.schedule_relative(3600, reminder).dispose()
    del reminder
    settle(loop)
    assert len(kept) <= 2 * FEW


def test_looking_for_cancelled_timers_costs_little_per_action(loop, monkeypatch):
    looked, tidy = [], Loop._tidy

    def look(*arguments):
        looked.append(arguments)
        tidy(*arguments)

    monkeypatch.setattr(Loop, "_tidy", look)
    for _ in range(20 * FEW):
        loop.schedule_relative(3600, Reminder())
    settle(loop)
    assert len(looked) <= 6  # each time twice as many


def test_remaining_timers_fire_in_order_after_cancellations(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    loop, seen, done = Loop(), [], Event()
    order = [n * 700 % 3001 for n in range(3001)]
    timers = {n: loop.schedule_relative(10 + n / 1000, lambda *_, n=n: seen.append(n)) for n in order}
    for n in order:
        if n % 3:
            timers[n].dispose()
    for _ in range(3001):
        loop.schedule(lambda *_: None)
    settle(loop)
    clock[0] += 20
    loop.schedule(lambda *_: done.set())
    assert done.wait(PATIENCE)
    loop.dispose()
    assert seen == list(range(0, 3001, 3))
