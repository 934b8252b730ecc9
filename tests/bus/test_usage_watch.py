from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
import zenoh
from reactivex.testing import TestScheduler

from contextpolicy.bus.decision_bus import usage_key
from contextpolicy.bus.session import LARGEST_WORD
from contextpolicy.bus.usage_watch import ASK_EVERY, OLD, UsageWatch, read_counters
from tests.cluster.builders import NODE


class Session:
    """Agents that answer when the test says so."""

    def __init__(self):
        self.questions = []

    def get(self, key, handler, *, timeout, **_):
        assert timeout > 0
        self.questions.append((key, handler))

    def answer(self, at, node=NODE, **containers):
        said = {
            name: dict(zip(("used", "periods", "throttled"), totals, strict=True))
            for name, totals in containers.items()
        }
        payload = zenoh.ZBytes(json.dumps({"at": at, "containers": said}).encode())
        reply = SimpleNamespace(ok=SimpleNamespace(key_expr=usage_key(node), payload=payload))
        self.questions[-1][1](reply)


@pytest.fixture
def clock():
    return TestScheduler(1000.0)


@pytest.fixture
def session():
    return Session()


@pytest.fixture
def watch(session, clock):
    return UsageWatch(session, clock, {NODE})


def test_usage_rate_needs_two_answers(watch, session, clock):
    assert watch.now() == {}
    session.answer(50.0, slam=(10.0, 100, 20))
    clock.advance_by(ASK_EVERY)
    assert watch.now() == {}
    session.answer(52.0, slam=(11.0, 120, 25))
    clock.advance_by(0.1)
    usage = watch.now()["slam"]
    assert (usage.cores, usage.throttled) == (0.5, 0.25)


def test_agents_are_asked_only_on_demand_and_once(watch, session, clock):
    for _ in range(5):
        watch.now()
    assert [key for key, _ in session.questions] == ["contextpolicy/agents/*/usage"]
    clock.advance_by(60.0)
    assert len(session.questions) == 1


def test_an_old_answer_is_not_shown(watch, session, clock):
    watch.now()
    session.answer(50.0, slam=(10.0, 100, 20))
    clock.advance_by(ASK_EVERY)
    watch.now()
    session.answer(51.0, slam=(11.0, 100, 20))
    clock.advance_by(0.1)
    assert watch.now()["slam"].throttled is None, "no period has passed"
    clock.advance_by(OLD)
    assert watch.now() == {}


def test_rate_ignores_the_time_without_a_watcher(watch, session, clock):
    watch.now()
    session.answer(50.0, slam=(10.0, 100, 20))
    clock.advance_by(OLD + ASK_EVERY)
    for at in (56.0, 57.0):
        assert watch.now() == {}
        session.answer(at, slam=(at, 100, 20))
        clock.advance_by(ASK_EVERY)
    assert watch.now()["slam"].cores == 1.0


def test_counters_of_gone_containers_expire(watch, session, clock):
    for number in range(20):
        watch.now()
        session.answer(50.0 + number, **{f"slam-{number}": (10.0, 100, 20)})
        clock.advance_by(ASK_EVERY)
    assert len(watch._last) <= OLD / ASK_EVERY


@pytest.mark.parametrize(
    "payload",
    [b"", b"[]", b"{}", b'{"at": 1}', b'{"at": "x", "containers": {}}', b'{"at": 1, "containers": {"a": {}}}', b"\xff"],
)
def test_unreadable_counters_are_ignored(payload):
    assert read_counters(payload) == {}


@pytest.mark.parametrize("who", [{"node": "ghost"}, {"node": NODE, "x" * LARGEST_WORD: (1.0, 1, 1)}])
def test_unknown_nodes_and_oversized_answers_are_ignored(watch, session, clock, who):
    for at in (50.0, 52.0):
        watch.now()
        session.answer(at, slam=(at, 100, 20), **who)
        clock.advance_by(ASK_EVERY)
    assert watch.now() == {}
