"""Which agents live and what they can do, in virtual time; tests/agent/bus_link has the same on a real bus."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.agent_failures import MOST_LINES, REST, AgentFailures
from contextpolicy.bus.agent_watch import BOUND, LONG_PATIENCE, PAUSE, RETURN, AgentWatch
from contextpolicy.bus.confirmations import MOST_WAITING, Confirmations
from contextpolicy.bus.doubts import FIRST, LONGEST
from contextpolicy.cluster.agent_reports import NO_ANSWER, NOT_CONFIRMING, AgentReport, Confirmation, write_confirmation
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE

if TYPE_CHECKING:
    import zenoh


def a_report(*lacks):
    return json.dumps({"missing": {"CFS": [], "Realtime": lacks}}).encode()


ABLE, FAIR = AgentReport("", ""), AgentReport("", "no kernel option")


class Bus:
    """A bus with a watch on it, which listens to the watch."""

    def __init__(self, session=None, nodes=(NODE,), **agents):
        self.nodes = set(nodes)
        self.session, self.scheduler = session or FakeSession(), TestScheduler()
        self.changes: list[dict[str, AgentReport]] = []
        self.session.agents |= agents
        self.confirmations: list[tuple[str, Confirmation]] = []
        self.published: dict[str, tuple[int, int, int]] = {}
        """The stamp of each policy's plan in force."""
        self.repeated = 0
        """How often a plan was published again for an agent on trial."""
        self.watch = AgentWatch(cast("zenoh.Session", self.session), self.scheduler, self, self.nodes)
        self.turn()

    def on_agents(self):
        self.changes.append(dict(self.watch.reports))

    def on_confirmation(self, node, said):
        self.confirmations.append((node, said))

    def on_trial(self, node):
        for policy, (run, sequence, edition) in self.published.items():
            self.repeated += 1
            self.publish(run, sequence, edition + 1, policy=policy, nodes=[node])

    def publish(self, *stamp, policy="lab/robot", nodes=(NODE,)):
        """A plan is published, which a later trial repeats."""
        self.published[policy] = stamp
        self.watch.expect(policy, stamp, nodes)

    def confirm_all(self):
        """The agent confirms what it heard last."""
        for policy, stamp in self.published.items():
            self.confirm(*stamp, policy=policy)

    def turn(self, seconds=0.01):
        self.scheduler.advance_by(seconds)
        self.session.answer()
        self.scheduler.advance_by(0.01)

    def confirm(self, *stamp, policy="lab/robot", failed=()):
        self.deliver(*stamp, policy=policy, failed=failed)
        self.scheduler.advance_by(0.01)

    def deliver(self, *stamp, policy="lab/robot", failed=()):
        """A confirmation arrives, and waits for the loop."""
        said = write_confirmation(Confirmation(policy, stamp, dict.fromkeys(failed, "Busy")))
        self.session.deliver_bytes("contextpolicy/agents/*/confirmed", said, f"contextpolicy/agents/{NODE}/confirmed")

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


def test_unheard_question_is_repeated():
    """The token came sooner than the word of who answers."""
    bus = Bus()
    bus.session.agent(NODE, a_report())
    report = bus.session.agents.pop(NODE)
    bus.turn()
    assert bus.watch.reports == {NODE: NO_ANSWER}
    bus.session.agents[NODE] = report
    bus.turn(PAUSE)
    assert bus.watch.reports == {NODE: ABLE}


def test_an_agent_that_is_gone_is_no_longer_asked():
    bus = Bus()
    bus.session.agent(NODE, None)
    bus.turn()
    bus.time_out()
    bus.session.agent_gone(NODE)
    bus.turn(PAUSE + LONG_PATIENCE)
    assert bus.session.questions == []
    bus.turn(RETURN)
    assert bus.changes == [{NODE: NO_ANSWER}, {}]


def test_a_node_keeps_its_limits_until_a_slow_agent_is_given_up():
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


def test_agent_that_returns_in_time_was_never_gone():
    bus = Bus(**{NODE: a_report()})
    bus.session.agent_gone(NODE)
    bus.turn(RETURN / 2)
    bus.session.agent(NODE, a_report())
    bus.turn()
    bus.turn(2 * RETURN)
    assert bus.changes == []


def test_late_answer_does_not_revive_a_lost_agent():
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


def questions_after(bus):
    """How many are open after all those of before have timed out."""
    bus.time_out()
    bus.turn(RETURN)
    return len(bus.session.questions)


def test_an_agent_that_flaps_is_asked_one_question_at_a_time():
    bus = Bus()
    bus.session.agent(NODE, None)
    for _ in range(5):
        bus.turn()
        bus.session.agent_gone(NODE)
        bus.session.agent(NODE, None)
    bus.turn()
    assert questions_after(bus) == 1


def test_a_question_that_a_later_one_replaced_is_not_repeated_when_it_times_out():
    bus = Bus()
    for _ in range(2):
        bus.session.agent(NODE, None)
        bus.turn()
    _, replaced = bus.session.questions.pop(0)
    assert replaced.drop is not None
    replaced.drop()
    bus.turn(PAUSE)
    assert len(bus.session.questions) == 1


def test_an_agent_that_flaps_between_two_questions_is_asked_at_once():
    bus = Bus()
    bus.session.agent(NODE, None)
    bus.turn()
    bus.time_out()
    bus.session.agent(NODE, None)
    bus.turn()
    assert len(bus.session.questions) == 1
    assert questions_after(bus) == 1


def test_a_frozen_agent_that_flaps_is_asked_one_question_at_a_time():
    bus = Bus(**{NODE: a_report()})
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.turn(BOUND)
    bus.session.agent_gone(NODE)
    bus.session.agent(NODE, None)
    bus.turn()
    assert questions_after(bus) == 1


def test_an_agent_that_ends_before_its_token_is_looked_for_is_given_up():
    class Session(FakeSession):
        def get(self, selector, handler=None, *, timeout, **_):
            answers = super().get(selector, handler, timeout=timeout)
            self.agents.clear()
            return answers

    bus = Bus(Session(), **{NODE: a_report()})
    assert bus.watch.reports == {NODE: ABLE}
    bus.turn(RETURN)
    assert bus.changes == [{}]


def test_a_closed_watch_receives_no_tokens():
    bus = Bus()
    bus.watch.close()
    bus.session.agent(NODE, a_report())
    bus.turn()
    assert bus.watch.reports == {}


@pytest.fixture
def bus():
    return Bus(**{NODE: a_report("no kernel option")})


def test_an_agent_that_confirms_in_time_is_counted_on(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE, "another-node"])
    bus.turn(BOUND / 2)
    bus.confirm(1, 1, 0)
    bus.turn(RETURN)
    assert bus.changes == []


def test_an_agent_that_realtime_tasks_keep_waiting_is_counted_on(bus):
    """With a period of 1 s each of operator, router and agent may wait for most of one."""
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE], 1.0)
    bus.turn(3.0)
    assert bus.changes == []
    bus.turn(BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


def test_a_frozen_agent_is_not_counted_on_until_it_answers_and_confirms(bus):
    """It may keep its token all the while."""
    bus.publish(1, 1, 0)
    bus.turn(BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]
    assert bus.session.questions == []
    report, bus.session.agents[NODE] = bus.session.agents[NODE], None
    bus.turn(FIRST)
    bus.time_out()
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}
    bus.session.agents[NODE] = report
    bus.turn(PAUSE)
    assert (bus.changes, bus.repeated) == ([{NODE: NOT_CONFIRMING}], 1)
    bus.confirm_all()
    assert bus.changes == [{NODE: NOT_CONFIRMING}, {NODE: FAIR}]


def test_an_agent_that_answers_but_refuses_plans_is_not_counted_on(bus):
    bus.publish(1, 1, 0)
    bus.turn(BOUND)
    for number in range(4):
        bus.turn(FIRST * 2**number + BOUND)
        assert bus.repeated == number + 1, "twice as long each time"
    bus.turn(50 * LONGEST)
    assert bus.changes == [{NODE: NOT_CONFIRMING}], "not counted on in between: that would move all requests"
    tries = bus.repeated
    bus.turn(LONGEST + 2 * BOUND)
    assert bus.repeated == tries + 1, "in the end, too"


def test_every_plan_in_force_must_be_confirmed_again(bus):
    bus.publish(1, 1, 0)
    bus.publish(7, 1, 0, policy="lab/other")
    bus.turn(BOUND)
    bus.turn(FIRST)
    bus.confirm(*bus.published["lab/robot"])
    bus.confirm(7, 1, 0, policy="lab/other")
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}
    bus.confirm_all()
    assert bus.watch.reports == {NODE: FAIR}


def test_a_plan_that_ends_during_a_trial_is_not_waited_for(bus):
    bus.publish(1, 1, 0)
    bus.turn(BOUND)
    bus.turn(FIRST)
    bus.watch.forget("lab/robot")
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}
    bus.turn()
    assert bus.watch.reports == {NODE: FAIR}


def test_the_next_version_of_a_policy_on_trial_must_be_confirmed(bus):
    bus.publish(1, 1, 0)
    bus.turn(BOUND)
    bus.turn(FIRST)
    bus.watch.forget("lab/robot")
    bus.publish(2, 1, 0)
    bus.turn()
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}
    bus.confirm_all()
    assert bus.watch.reports == {NODE: FAIR}


def late(bus, sequence):
    """A plan is not confirmed in time."""
    bus.publish(1, sequence, 0)
    bus.turn(BOUND)
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}


def test_an_agent_that_is_late_time_and_again_is_left_alone_longer(bus):
    for number in range(3):
        late(bus, number + 1)
        bus.turn(FIRST * 2**number - 0.1)
        assert bus.repeated == number
        bus.turn(0.1)
        bus.confirm_all()
        assert bus.watch.reports == {NODE: FAIR}
    bus.turn(LONGEST)
    late(bus, 9)
    bus.turn(FIRST)
    assert bus.repeated == 4, "it was good for long"


def test_an_agent_that_restarts_during_a_pause_is_tried_at_once(bus):
    late(bus, 1)
    bus.session.agent_gone(NODE)
    bus.session.agent(NODE, a_report())
    bus.turn()
    bus.confirm_all()
    assert bus.watch.reports == {NODE: ABLE}


def test_agent_that_ends_during_its_trial_is_not_counted_on(bus):
    late(bus, 1)
    bus.turn(FIRST)
    bus.session.agent_gone(NODE)
    bus.turn()
    bus.confirm_all()
    assert bus.watch.reports == {NODE: NOT_CONFIRMING}
    bus.turn(RETURN)
    assert bus.watch.reports == {}


def test_agent_that_comes_up_under_a_plan_must_confirm_it():
    bus = Bus()
    bus.publish(1, 1, 0)
    bus.session.agent(NODE, a_report())
    bus.turn()
    assert (bus.watch.reports, bus.repeated) == ({}, 1)
    bus.confirm_all()
    assert bus.changes == [{NODE: ABLE}]


def test_agent_that_replaces_another_in_time_must_confirm_the_plan_too(bus):
    bus.publish(1, 1, 0)
    bus.confirm_all()
    bus.session.agent_gone(NODE)
    bus.session.agent(NODE, a_report("no kernel option"))
    bus.turn()
    assert (bus.changes, bus.repeated) == ([], 1)
    bus.turn(BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


def test_an_agent_that_has_a_plan_to_confirm_receives_no_other(bus):
    bus.watch.look(NODE)
    bus.publish(1, 1, 0)
    bus.turn()
    bus.confirm_all()
    bus.watch.look(NODE)
    bus.turn()
    assert bus.repeated == 0


def test_late_confirmation_does_not_restore_trust_at_once(bus):
    """An agent that is always late would be counted on and given up with every plan."""
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.turn(BOUND)
    bus.confirm(1, 1, 0)
    bus.turn(RETURN / 2)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


def test_confirming_a_later_plan_covers_earlier_ones(bus):
    """Agents skip plans that newer ones overtook."""
    for sequence in (1, 2, 3):
        bus.watch.expect("lab/robot", (1, sequence, 0), [NODE])
    bus.confirm(1, 3, 0)
    bus.turn(2 * BOUND)
    assert bus.changes == []


def test_after_an_older_plan_the_last_one_has_its_own_time(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.turn(BOUND / 2)
    bus.watch.expect("lab/robot", (1, 2, 0), [NODE])
    bus.confirm(1, 1, 0)
    bus.turn(0.9 * BOUND)
    assert bus.changes == []
    bus.turn(0.2 * BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


@pytest.mark.parametrize("stamp", [(1, 0, 0), (0, 9, 9)])
def test_an_older_plan_confirms_no_later_one(bus, stamp):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.confirm(*stamp)
    bus.confirm(1, 1, 0, policy="lab/other")
    bus.turn(BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


def test_forgotten_policy_expects_no_confirmation(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.watch.forget("lab/robot")
    bus.turn(BOUND)
    assert bus.changes == []


def test_absent_agent_has_a_grace_period(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.session.agent_gone(NODE)
    bus.turn(BOUND)
    assert bus.changes == []


@pytest.mark.parametrize("said", [b"", b"[]", b'{"stamp": 1}', b'{"policy": "a/b", "stamp": [1, "x", null]}'])
def test_unreadable_confirmation_is_ignored(bus, said):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.session.deliver_bytes("contextpolicy/agents/*/confirmed", said, f"contextpolicy/agents/{NODE}/confirmed")
    bus.turn(BOUND)
    assert bus.changes == [{NODE: NOT_CONFIRMING}]


def test_failures_are_kept_until_a_plan_succeeds(bus):
    for sequence, failed in enumerate((["a"], ["a"], ["a", "b"], []), 1):
        bus.watch.expect("lab/robot", (1, sequence, 0), [NODE])
        bus.confirm(1, sequence, 0, failed=failed)
        assert bus.watch.failures("lab/robot") == ({NODE: dict.fromkeys(failed, "Busy")} if failed else {})
        bus.turn(REST)
    assert len(bus.changes) == 3, "the second plan changed nothing"
    bus.turn(2 * BOUND)
    assert bus.watch.reports == {NODE: FAIR}


def test_only_the_newest_confirmation_of_a_policy_waits_for_the_loop(bus):
    """All were queued: an agent's certificate was enough to fill the operator's memory."""
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    for sequence in (*range(1000), 3):
        bus.deliver(1, sequence, 0)
    bus.turn()
    assert bus.confirmations == [(NODE, Confirmation("lab/robot", (1, 999, 0)))]


def test_confirmations_about_unknown_policies_take_few_places():
    heard: list[str] = []
    listener, loop = SimpleNamespace(on_confirmed=lambda _, said: heard.append(said.policy)), TestScheduler()
    confirmations = Confirmations(loop, listener, {NODE}, {"lab/robot"})
    session = FakeSession()
    session.declare_subscriber("contextpolicy/agents/*/confirmed", confirmations.on_sample)
    for policy in (*(f"lab/unknown-{number}" for number in range(2 * MOST_WAITING)), "lab/robot"):
        said = write_confirmation(Confirmation(policy, (1, 1, 1)))
        session.deliver_bytes("contextpolicy/agents/*/confirmed", said, f"contextpolicy/agents/{NODE}/confirmed")
    loop.advance_by(1.0)
    assert (len(heard), heard[-1]) == (MOST_WAITING + 1, "lab/robot")


def test_failures_that_change_without_pause_are_reported_at_times(bus, caplog):
    """Each change makes all policies' claims anew."""
    bus.watch.expect("lab/robot", (1, 0, 0), [NODE])
    for sequence in range(100):
        bus.confirm(1, sequence, 0, failed=[f"containerd://{sequence}"])
    bus.turn(REST)
    assert 1 < len(bus.changes) <= 100 * 0.02 / REST + 2
    assert len(caplog.messages) == len(bus.changes)
    before = len(bus.changes)
    bus.confirm(1, 100, 0)
    bus.turn(REST)
    assert (len(bus.changes), bus.watch.failures("lab/robot")) == (before + 1, {})


def test_log_of_failures_is_bounded(caplog):
    listener = SimpleNamespace(on_agents=lambda: None)
    failures = AgentFailures(scheduler := TestScheduler(), listener)
    for node in range(100):
        named = {f"containerd://{n}": f"{n:064}" for n in range(100)}
        failures.take(f"node-{node}", Confirmation("lab/robot", (1, 1, 1), named))
    scheduler.advance_by(10 * REST)
    assert len(caplog.messages) == 1 + MOST_LINES + 1
    assert max(map(len, caplog.messages)) < 500


def test_a_confirmation_for_a_withdrawn_plan_is_ignored(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.watch.forget("lab/robot")
    bus.confirm(1, 1, 0, failed=["a"])
    assert (bus.watch.failures("lab/robot"), bus.changes, bus.confirmations) == ({}, [], [])


def test_failures_are_forgotten_with_their_policy_or_agent(bus):
    for policy in ("lab/robot", "lab/other"):
        bus.watch.expect(policy, (1, 1, 0), [NODE])
    bus.confirm(1, 1, 0, failed=["a"])
    bus.confirm(1, 1, 0, policy="lab/other", failed=["b"])
    bus.watch.forget("lab/robot")
    assert (bus.watch.failures("lab/robot"), list(bus.watch.failures("lab/other"))) == ({}, [NODE])
    bus.session.agent_gone(NODE)
    bus.turn(RETURN)
    bus.turn(RETURN)
    assert bus.watch.failures("lab/other") == {}


def test_confirmation_is_reported_with_its_node(bus):
    bus.watch.expect("lab/robot", (1, 3, 0), [NODE])
    bus.confirm(1, 3, 0, failed=["a"])
    assert bus.confirmations == [(NODE, Confirmation("lab/robot", (1, 3, 0), {"a": "Busy"}))]


# anyone with an agent's certificate may invent nodes

GHOST = "ghost"


def test_agent_of_an_unknown_node_is_not_asked():
    bus = Bus()
    bus.session.agent(GHOST, a_report())
    bus.turn(2 * RETURN)
    assert (bus.watch.reports, bus.changes, bus.session.questions) == ({}, [], [])


def test_an_agent_of_an_unknown_node_is_dropped_once_nodes_are_listed():
    bus = Bus(nodes=(), **{NODE: a_report(), GHOST: a_report()})
    assert bus.watch.reports == {NODE: ABLE, GHOST: ABLE}
    bus.nodes.add(NODE)
    bus.watch.look(NODE)
    bus.turn()
    bus.turn(RETURN)
    assert bus.watch.reports == {NODE: ABLE}


def test_an_agent_is_asked_as_soon_as_its_node_is_known():
    bus = Bus(nodes=())
    bus.session.agent(NODE, a_report())
    bus.turn()
    assert bus.watch.reports == {}
    bus.nodes.add(NODE)
    bus.watch.look(NODE)
    bus.turn()
    bus.turn()
    assert bus.watch.reports == {NODE: ABLE}


def test_confirmation_from_an_unknown_node_is_ignored(bus):
    bus.watch.expect("lab/robot", (1, 1, 0), [NODE])
    bus.nodes.discard(NODE)
    bus.confirm(1, 1, 0, failed=["containerd://x"])
    assert (bus.confirmations, bus.watch.failures("lab/robot")) == ([], {})


def test_lost_agent_is_reported_gone_until_it_returns():
    bus = Bus(**{NODE: a_report()})
    bus.session.agent_gone(NODE)
    bus.turn(RETURN / 2)
    assert bus.watch.gone == set()
    bus.turn(RETURN)
    assert bus.watch.gone == {NODE}
    bus.session.agent(NODE, a_report())
    bus.turn()
    assert bus.watch.gone == set()


def test_agent_of_a_removed_node_is_not_reported_gone():
    bus = Bus(**{NODE: a_report()})
    bus.nodes.discard(NODE)
    bus.session.agent_gone(NODE)
    bus.turn(2 * RETURN)
    assert (bus.watch.reports, bus.watch.gone) == ({}, set())
