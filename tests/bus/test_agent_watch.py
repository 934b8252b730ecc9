"""Which agents live and what they can do, in virtual time; tests/agent/test_bus_link.py has the same on a real bus."""

from __future__ import annotations

import json

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.agent_watch import LONG_PATIENCE, PAUSE, RETURN, AgentWatch
from contextpolicy.cluster.agent_reports import NO_ANSWER, AgentReport
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE


def a_report(*lacks):
    return json.dumps({"missing": {"CFS": [], "Realtime": lacks}}).encode()


ABLE, FAIR = AgentReport("", ""), AgentReport("", "no kernel option")


class Bus:
    """A bus with a watch on it."""

    def __init__(self, **agents):
        self.session, self.scheduler, self.changes = FakeSession(), TestScheduler(), []
        self.session.agents |= agents
        self.watch = AgentWatch(self.session, self.scheduler, lambda: self.changes.append(dict(self.watch.reports)))
        self.turn()

    def turn(self, seconds=0.01):
        self.scheduler.advance_by(seconds)
        self.session.answer()
        self.scheduler.advance_by(0.01)

    def time_out(self):
        """Nobody answers in time."""
        self.session.time_out()
        self.scheduler.advance_by(0.01)


def test_agents_that_live_already_are_known_at_once_and_asked_once_more():
    bus = Bus(**{NODE: a_report()})
    assert bus.watch.reports == {NODE: ABLE}
    assert (bus.changes, bus.session.questions) == ([], [])


def test_an_agent_that_comes_up_is_asked():
    bus = Bus()
    bus.session.agent(NODE, a_report("no kernel option"))
    bus.turn()
    assert bus.changes == [{NODE: FAIR}]


@pytest.mark.parametrize("already", [True, False], ids=["at the start", "later"])
def test_an_agent_that_is_slow_is_asked_again_until_it_answers(already):
    bus = Bus(**({NODE: None} if already else {}))
    if not already:
        bus.session.agent(NODE, None)
        bus.turn()
    assert bus.watch.reports == {}
    for _ in range(3):
        bus.time_out()
        assert bus.watch.reports == {NODE: NO_ANSWER}
        bus.turn(PAUSE)
        assert len(bus.session.questions) == 1
    bus.session.agents[NODE] = a_report()
    bus.turn()
    assert bus.changes == [{NODE: NO_ANSWER}, {NODE: ABLE}]
    bus.turn(10 * (PAUSE + LONG_PATIENCE))
    assert bus.session.questions == []


def test_a_question_that_nobody_heard_is_asked_again():
    """The token came sooner than the word of who answers."""
    bus = Bus()
    bus.session.agent(NODE, a_report())
    report = bus.session.agents.pop(NODE)
    bus.turn()
    assert bus.watch.reports == {NODE: NO_ANSWER}
    bus.session.agents[NODE] = report
    bus.turn(PAUSE)
    assert bus.watch.reports == {NODE: ABLE}


def test_an_agent_that_is_gone_is_asked_no_more():
    bus = Bus()
    bus.session.agent(NODE, None)
    bus.turn()
    bus.time_out()
    bus.session.agent_gone(NODE)
    bus.turn(PAUSE + LONG_PATIENCE)
    assert bus.session.questions == []
    bus.turn(RETURN)
    assert bus.changes == [{NODE: NO_ANSWER}, {}]


def test_a_node_keeps_what_it_has_while_its_next_agent_is_slow_until_it_is_given_up():
    bus = Bus(**{NODE: a_report()})
    bus.session.agent_gone(NODE)
    bus.turn(RETURN / 2)
    bus.session.agent(NODE, None)
    bus.turn()
    bus.time_out()
    assert bus.changes == []
    bus.turn(RETURN / 2)
    assert bus.changes == [{NODE: NO_ANSWER}]
    bus.session.agents[NODE] = a_report()
    bus.turn(PAUSE)
    assert bus.watch.reports == {NODE: ABLE}


def test_an_agent_that_is_back_and_answers_was_not_gone():
    bus = Bus(**{NODE: a_report()})
    bus.session.agent_gone(NODE)
    bus.turn(RETURN / 2)
    bus.session.agent(NODE, a_report())
    bus.turn()
    bus.turn(2 * RETURN)
    assert bus.changes == []


def test_an_answer_after_the_agent_has_gone_brings_it_not_back():
    bus = Bus()
    bus.session.agent(NODE, a_report())
    bus.scheduler.advance_by(0.01)
    [(_, callback)] = bus.session.questions
    answers = bus.session._answers(f"contextpolicy/agents/{NODE}")
    bus.session.agent_gone(NODE)
    bus.turn()
    callback(answers[0])
    bus.turn(2 * RETURN)
    assert bus.watch.reports == {}


def test_a_watch_that_is_closed_hears_no_tokens():
    bus = Bus()
    bus.watch.close()
    bus.session.agent(NODE, a_report())
    bus.turn()
    assert bus.watch.reports == {}
