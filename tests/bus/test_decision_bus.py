"""One policy's place on the bus: what it publishes, answers, signs and withdraws."""

from __future__ import annotations

import time

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.decision_bus import Bus, agent_key, applied_key, plan_key, policy_of, topic_key
from contextpolicy.bus.questions import MOST_WAITING, Questions
from contextpolicy.bus.signatures import Signer, UnsignedPlans, Verifier
from tests.bus.certificates import signing_keys
from tests.bus.deciding import POLICY
from tests.bus.fake_session import FakeSession
from tests.virtual_operator import OpenFence

PLAN = b'{"n":1}'


def test_keys():
    assert plan_key("lab", "robot") == "contextpolicy/lab/robot/plan"
    assert applied_key("lab", "robot") == "contextpolicy/lab/robot/applied"
    assert topic_key("lab", "robot", "explain") == "contextpolicy/lab/robot/explain"
    assert agent_key("robot-1") == "contextpolicy/agents/robot-1"
    assert {policy_of(key("lab", "robot")) for key in (plan_key, applied_key)} == {"lab/robot"}


@pytest.fixture
def scheduler():
    return TestScheduler()


@pytest.fixture
def session():
    return FakeSession()


class Asked:
    """What queries are answered with; `plan` is there to be changed."""

    def __init__(self, plan):
        self.plan = plan

    def message(self):
        return self.plan

    def explain(self):
        return {"why": "so"}

    def board(self):
        return {"shows": "all"}


def a_bus(session, scheduler, answers=None, signer=None, fence=None):
    answers, fence = answers or Asked({"n": 1}), fence or OpenFence()
    return Bus(
        session, POLICY, Questions(scheduler, lambda: 0.0), answers, signer=signer or UnsignedPlans(), fence=fence
    )


def test_what_is_published_goes_to_the_policys_keys(session, scheduler):
    bus = a_bus(session, scheduler)
    bus.publish({"n": 1})
    bus.publish_applied({"stage": "accepted"})
    bus.withdraw()
    assert session.published == [
        ("contextpolicy/lab/robot/plan", {"n": 1}),
        ("contextpolicy/lab/robot/applied", {"stage": "accepted"}),
        ("contextpolicy/lab/robot/plan", None),
    ]


def test_questions_are_answered_on_the_loop_with_current_data(session, scheduler):
    answers = Asked({"n": 1})
    a_bus(session, scheduler, answers)
    plan, why = session.ask("contextpolicy/lab/robot/plan"), session.ask("contextpolicy/lab/robot/explain")
    assert (plan.answers, why.answers) == ([], [])
    answers.plan = {"n": 2}
    scheduler.advance_by(1)
    assert (plan.answers, why.answers) == ([{"n": 2}], [{"why": "so"}])


def test_excess_queries_are_answered_at_once(session, scheduler):
    a_bus(session, scheduler, Asked({"n": 1}))
    for _ in range(2):
        queries = [session.ask("contextpolicy/lab/robot/explain") for _ in range(MOST_WAITING + 10)]
        assert [query.ended for query in queries] == [False] * MOST_WAITING + [True] * 10
        scheduler.advance_by(1)
        assert [len(query.answers) for query in queries] == [1] * MOST_WAITING + [0] * 10
        assert all(query.ended for query in queries)


def test_oversized_question_is_ended_at_once(session, scheduler):
    a_bus(session, scheduler, Asked({"n": 1}))
    small, large = (session.ask("contextpolicy/lab/robot/plan", attachment=b"x" * size) for size in (4096, 4097))
    scheduler.advance_by(1)
    assert (small.answers, large.answers, large.ended) == ([{"n": 1}], [], True)


def test_failing_answer_frees_its_place_in_the_queue(session, scheduler):
    class Failing(Asked):
        def message(self):
            raise RuntimeError("no")

    a_bus(session, scheduler, Failing(None))
    for _ in range(MOST_WAITING + 1):
        query = session.ask("contextpolicy/lab/robot/plan")
        with pytest.raises(RuntimeError):
            scheduler.advance_by(1)
        scheduler.stop()
        assert query.ended


def test_without_a_plan_there_is_no_answer(session, scheduler):
    a_bus(session, scheduler, Asked(None))
    query = session.ask("contextpolicy/lab/robot/plan")
    scheduler.advance_by(1)
    assert query.answers == []


def test_liveliness_token_announces_the_planner(session, scheduler):
    bus = a_bus(session, scheduler)
    assert [token.key for token in session.tokens] == ["contextpolicy/lab/robot/plan"]
    bus.close()
    assert session.everything_declared() == []


def test_plans_withdrawals_and_answers_are_signed(session, scheduler, tmp_path):
    keys = signing_keys(tmp_path)
    verifier, key = Verifier(keys), plan_key("lab", "robot")
    bus = a_bus(session, scheduler, signer=Signer(keys))
    bus.publish({"n": 1})
    bus.withdraw()
    query, why = session.ask(key), session.ask(topic_key("lab", "robot", "explain"))
    scheduler.advance_by(1)
    for payload, attachment in zip((PLAN, None, PLAN), (*session.attachments, *query.attachments), strict=True):
        assert verifier.check(key, payload, attachment, time.time_ns())
    assert why.attachments == [None]


def test_without_a_key_nothing_is_signed(session, scheduler):
    a_bus(session, scheduler).publish({"n": 1})
    assert session.attachments == [None]


def test_an_operator_that_lost_its_lease_is_silent_at_once(session, scheduler):
    fence = OpenFence()
    bus = a_bus(session, scheduler, fence=fence)
    query = session.ask("contextpolicy/lab/robot/plan")
    fence.open = False
    assert bus.publish({"n": 1}) is None
    bus.withdraw()
    bus.publish_applied({"stage": "accepted"})
    scheduler.advance_by(1)
    assert (session.published, query.answers) == ([], [])
