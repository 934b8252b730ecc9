"""What publishers of latched topics kept is asked for at times, and heard once; test_subscription has real ones."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh
from reactivex.testing import TestScheduler

from contextpolicy.streams.latched import MOST_KEYS, PAUSE, Newest, subscribe_latched
from tests.bus.fake_session import FakeSession

TOKEN = SimpleNamespace(kind=zenoh.SampleKind.PUT)


def stamp(second, sender=1):
    return zenoh.Timestamp(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=second), bytes([sender]))


@pytest.fixture
def loop():
    return TestScheduler()


@pytest.fixture
def session():
    return FakeSession()


@pytest.fixture
def heard():
    return []


@pytest.fixture
def end(session, loop, heard):
    return subscribe_latched(cast("Any", session), "robot/*/map", heard.append, loop)


def appear(session):
    [watcher] = session.watchers
    watcher.callback(TOKEN)


def kept(key, at):
    return SimpleNamespace(ok=SimpleNamespace(key_expr=zenoh.KeyExpr(key), timestamp=stamp(at)))


@pytest.mark.usefixtures("end")
def test_publishers_are_asked_at_once_and_then_at_times(session, loop):
    """Zenoh's subscriber asked each one as it appeared, and kept a place for it for ever."""
    loop.advance_by(0.01)
    assert [selector for selector, _ in session.questions] == ["robot/*/map/@adv/**?_max=1"]
    for _ in range(100):
        for _ in range(100):
            appear(session)
        loop.advance_by(PAUSE / 10)
    assert 10 <= len(session.questions) - 1 <= 11
    loop.advance_by(10 * PAUSE)
    asked = len(session.questions)
    loop.advance_by(100 * PAUSE)
    assert len(session.questions) == asked


def test_no_publisher_is_asked_after_the_end(session, loop, end):
    loop.advance_by(0.01)
    appear(session)
    end()
    assert session.everything_declared() == []
    loop.advance_by(10 * PAUSE)
    assert len(session.questions) == 1


@pytest.mark.usefixtures("end")
def test_kept_sample_is_received_once_and_none_of_another_key(session, loop, heard):
    loop.advance_by(0.01)
    [(_, answer)] = session.questions
    for key, at in (("a/map", 1), ("a/map", 1), ("b/map", 1), ("b/other", 2), ("a/map", 3)):
        answer(kept(f"robot/{key}", at))
    answer(SimpleNamespace(ok=None))
    assert [str(sample.key_expr) for sample in heard] == ["robot/a/map", "robot/b/map", "robot/a/map"]


def test_kept_sample_is_dropped_if_a_live_one_is_newer():
    newest = Newest()
    newest.note("map", stamp(5))
    assert [newest.admit("map", stamp(at)) for at in (4, 5, 6, 6)] == [False, False, True, False]


def test_live_sample_that_claims_to_come_from_the_future_hides_nothing_for_good():
    newest = Newest()
    newest.note("map", stamp(10**6, sender=2))
    newest.note("map", stamp(5))
    assert newest.admit("map", stamp(6))


@pytest.mark.parametrize(("live", "kept"), [(None, 1), (1, None), (None, None)])
def test_without_a_timestamp_the_live_sample_counts(live, kept):
    newest = Newest()
    newest.note("map", live and stamp(live))
    assert not newest.admit("map", kept and stamp(kept))
    assert newest.admit("other", kept and stamp(kept))


def test_memory_does_not_grow_with_keys_and_senders():
    """For each sender that a sample named, some 200 bytes were kept for ever: 5 MB a second."""
    newest = Newest()
    for number in range(100 * MOST_KEYS):
        newest.note(f"robot/{number}", stamp(1, 1 + number % 255))
        newest.note("robot/map", stamp(1, 1 + number % 255))
    assert len(newest._stamps) == MOST_KEYS
    assert not newest.admit("robot/map", stamp(0))
