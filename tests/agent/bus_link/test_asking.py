"""Sources are asked for their plans until they say them, and of plans that wait the newest counts."""

from __future__ import annotations

import json
import threading
import time
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh
from reactivex.testing import TestScheduler

from contextpolicy.agent.bus_link import AgentBus
from contextpolicy.bus import agent_watch as agents
from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.bus.decision_bus import agent_key, plan_key, usage_key
from contextpolicy.bus.questions import MOST_WAITING
from contextpolicy.bus.signatures import Signer, Verifier
from contextpolicy.cluster.agent_reports import AgentReport
from tests.agent.builders import NODE
from tests.agent.bus_link.listening import KEY, POLICY, Asked, Copied, Listener
from tests.bus.certificates import signing_keys
from tests.modules.robotkit.bus import client
from tests.waiting import PATIENCE, until


def test_source_is_asked_for_its_plan_and_reported_lost(bus, operator, listener, sign):  # noqa: ARG001
    def answer(query):
        query.reply(query.key_expr, b"in force", attachment=sign(b"in force"))

    with operator.declare_queryable(KEY, answer):
        token = operator.liveliness().declare_token(KEY)
        listener.expect((POLICY, "found"), (POLICY, b"in force"))
        token.undeclare()
        listener.expect((POLICY, "found"), (POLICY, b"in force"), (POLICY, "lost"))


def test_an_agent_that_did_not_answer_in_time_is_asked_again(address, operator, scheduler, close, monkeypatch):
    monkeypatch.setattr(agents, "PATIENCE", 0.05)
    monkeypatch.setattr(agents, "PAUSE", 0.01)
    held: list[zenoh.Query] = []
    watcher = Listener()
    watch = AgentWatch(operator, scheduler, watcher, {NODE})
    with client(address) as session:

        def answer(query):
            if not held:
                held.append(query)
                return
            with query:
                query.reply(query.key_expr, json.dumps(Listener().report()).encode())

        queryable = session.declare_queryable(agent_key(NODE), answer)
        token = session.liveliness().declare_token(agent_key(NODE))
        watcher.expect("changed", "changed")
        assert watch.reports == {NODE: AgentReport("", "")}
        held.pop().drop()
        token.undeclare()
        queryable.undeclare()
    close(watch)


@pytest.fixture
def asked(verifier, listener):
    """The session of an agent in virtual time."""
    scheduler = TestScheduler()
    session = Asked(scheduler)
    session.bus = AgentBus(cast("Any", session), NODE, scheduler, listener, verifier)
    session.say_token(zenoh.SampleKind.PUT)
    return session


def test_source_is_asked_until_it_answers(asked):
    asked.wait(10)
    assert [(key, round(at)) for key, at in asked.asked] == [(KEY, at) for at in (0, 1, 3, 7)]
    asked.bus._put(POLICY, b"plan", 1)
    asked.wait(1000)
    assert len(asked.asked) == 4


def test_a_source_that_is_gone_is_not_asked(asked):
    asked.wait(2)
    asked.say_token(zenoh.SampleKind.DELETE)
    asked.wait(1000)
    assert len(asked.asked) == 2


def test_closed_agent_asks_no_source(asked):
    asked.wait(2)
    asked.bus.close()
    asked.wait(1000)
    assert len(asked.asked) == 2


@pytest.fixture
def answered(asked, listener):
    """The source has said its plan, which is in force."""
    asked.bus._put(POLICY, b"plan", 1)
    asked.wait(0.1)
    listener.in_force = True
    return asked


@pytest.mark.parametrize("attachment", [None, bytes(72)], ids=["unsigned", "forged"])
def test_source_is_asked_again_after_a_message_without_proof(answered, attachment):
    """It may be the operator itself, with a key that the agent does not know."""
    answered.say(b"plan", attachment)
    answered.wait(5)
    assert [round(at) for _, at in answered.asked] == [0, 1, 3]


def test_a_flood_of_forged_plans_has_the_source_asked_no_more_often(answered):
    for _ in range(50):
        answered.say(b"plan")
        answered.wait(0.1)
    assert [round(at) for _, at in answered.asked] == [0, 1, 3]


class Answered(Asked):
    """Its source answers, with whatever key it has by then."""

    def __init__(self, scheduler, keys):
        super().__init__(scheduler)
        self._keys = keys

    def get(self, selector, handler: Any = None, **_):
        super().get(selector)
        signed = Copied(Signer(self._keys).sign(KEY, b"plan", time.time_ns()))
        plan = SimpleNamespace(key_expr=KEY, kind=zenoh.SampleKind.PUT, payload=Copied(b"plan"), attachment=signed)
        handler.callback(SimpleNamespace(ok=plan))


@pytest.mark.parametrize("first", ["operator", "agent"])
def test_key_that_is_replaced_in_the_wrong_order_counts_once_both_have_it(tmp_path, listener, first):
    """However long the other takes: the plan was given up meanwhile, and nothing new happens."""
    keys = {side: signing_keys(tmp_path / side) for side in ("operator", "agent")}
    scheduler = TestScheduler()
    session = Answered(scheduler, keys["operator"])
    AgentBus(cast("Any", session), NODE, scheduler, listener, Verifier(keys["agent"]))
    session.say_token(zenoh.SampleKind.PUT)
    session.wait(3600)
    assert set(listener.events) == {(POLICY, "found"), "Forged"}
    new, late = keys[first], keys["agent" if first == "operator" else "operator"]
    for name in ("tls.crt", "tls.key"):
        fresh = late / f"..{name}"
        fresh.write_bytes((new / name).read_bytes())
        fresh.replace(late / name)
    session.wait(31)
    assert listener.events[-1] == (POLICY, b"plan")


def test_a_source_that_publishes_meanwhile_is_not_asked(answered):
    answered.say(b"plan")
    answered.bus._put(POLICY, b"plan", 2)
    answered.wait(1000)
    assert len(answered.asked) == 1


@pytest.mark.parametrize("ago", [0, 60], ids=["repeated", "too old"])
def test_what_the_operator_has_signed_puts_nothing_in_doubt(answered, sign, ago):
    said = sign(b"plan", ago=ago)
    for _ in range(2):
        answered.say(b"plan", said)
    answered.wait(1000)
    assert len(answered.asked) == 1


def test_forged_plan_of_a_policy_without_one_in_force_asks_no_source(answered, listener):
    listener.in_force = False
    answered.say(b"plan")
    answered.wait(1000)
    assert len(answered.asked) == 1


@pytest.mark.parametrize("key", [agent_key(NODE), usage_key(NODE)], ids=["report", "usage"])
def test_a_flood_of_questions_delays_no_plan(asked, listener, key):
    """All were queued for the loop, whatever they carried: thousands before a plan, which then came too late."""
    queries = [asked.ask(key) for _ in range(1000)]
    listener.queries = queries
    asked.bus._put(POLICY, b"plan", 1)
    assert [query.ended for query in queries] == [False] * MOST_WAITING + [True] * (1000 - MOST_WAITING)
    asked.wait(60)
    assert listener.answered == [1]
    assert [len(query.answers) for query in queries[:MOST_WAITING]] == [1] * MOST_WAITING


@pytest.mark.parametrize("part", ["payload", "attachment"])
def test_large_question_is_ended_at_once(asked, part):
    assert asked.ask(agent_key(NODE), **{part: bytes(5000)}).ended


def test_use_is_read_once_for_all_who_ask_at_once(asked, listener):
    """It takes a file for each container."""
    for reads in (1, 2):
        queries = [asked.ask(usage_key(NODE)) for _ in range(MOST_WAITING)]
        asked.wait(0.2)
        assert all(query.answers for query in queries)
        assert listener.reads == reads
        asked.wait(1.0)


def test_newest_signed_of_waiting_plans_wins(bus, scheduler, listener):
    """Saying an older plan again must not take the place of a newer one."""
    go = threading.Event()
    scheduler.schedule(lambda *_: go.wait(PATIENCE))
    bus._put(POLICY, b"newer", 2)
    bus._put(POLICY, b"older", 1)
    go.set()
    listener.expect((POLICY, b"newer"))


def test_flood_of_old_plans_leaves_one_of_each_policy_waiting(bus, scheduler, listener):
    go = threading.Event()
    scheduler.schedule(lambda *_: go.wait(PATIENCE))
    for payload in (b"old", b"as old", b"older"):
        bus._put_too_old(POLICY, payload, 1)
    go.set()
    listener.expect((POLICY, "missed", b"older"))


def test_replayed_plans_are_refused_while_newer_ones_wait(bus, operator, scheduler, listener, sign):
    """All arrive before the loop has time for one: only the newest is carried out, and none is lost unseen."""
    go = threading.Event()
    said = [(payload, sign(payload)) for payload in (b"older", b"newer")]
    for number, (payload, attachment) in enumerate(said, 1):
        operator.put(KEY, payload, attachment=attachment)
        listener.wait(number)
    scheduler.schedule(lambda *_: go.wait(PATIENCE))
    withdrawal = sign(None)
    operator.delete(KEY, attachment=withdrawal)
    for payload, attachment in said:
        operator.put(KEY, payload, attachment=attachment)
    operator.delete(KEY, attachment=withdrawal)
    operator.put(plan_key("robot", "last"), b"plan", attachment=sign(b"plan", plan_key("robot", "last")))
    until(lambda: "robot/last" in bus._waiting)
    go.set()
    listener.wait(7)
    assert listener.events.count("Repeated") == 3
    assert set(listener.events[2:]) == {(POLICY, None), "Repeated", ("robot/last", b"plan")}
