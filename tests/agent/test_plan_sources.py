"""For how long a plan holds that no source confirms."""

from __future__ import annotations

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent.plan_sources import LEAST, PlanSources
from contextpolicy.agent.retries import AGAIN
from tests.agent.builders import POLICY

GRACE = 10.0


class Given:
    """Notes when a plan is given up."""

    def __init__(self, grace=GRACE):
        self.time, self.up = TestScheduler(), []
        self.sources = PlanSources(self.time, grace, self)
        self.wait = self.time.advance_by

    def on_silence(self, policy):
        self.up.append((policy, self.time.clock))


@pytest.fixture
def given():
    """A policy whose source is alive."""
    given = Given()
    given.sources.find(POLICY)
    return given


def test_a_plan_holds_while_its_source_lives(given):
    given.sources.hold(POLICY)
    given.wait(1000)
    assert (POLICY in given.sources, given.up) == (True, [])


def test_a_plan_whose_source_is_gone_is_given_up(given):
    given.sources.lose(POLICY)
    given.wait(1000)
    assert (POLICY in given.sources, given.up) == (False, [(POLICY, GRACE)])


def test_a_plan_that_arrives_without_a_source_postpones_nothing():
    given = Given()
    for _ in range(4):
        given.sources.hold(POLICY)
        given.wait(3)
    assert given.up == [(POLICY, GRACE)]


def test_an_unproven_source_is_given_up_however_many_messages_come(given):
    for _ in range(4):
        given.sources.doubt(POLICY)
        given.wait(3)
    assert given.up == [(POLICY, GRACE)]


def test_a_plan_that_its_source_repeats_holds(given):
    given.sources.doubt(POLICY)
    given.wait(GRACE - 1)
    given.sources.hold(POLICY)
    given.wait(1000)
    assert given.up == []


def test_doubt_does_not_postpone_the_end_of_a_source_that_is_gone(given):
    given.sources.lose(POLICY)
    given.wait(GRACE - 1)
    given.sources.doubt(POLICY)
    given.wait(1)
    assert given.up == [(POLICY, GRACE)]


def test_a_source_in_doubt_has_time_for_two_questions_however_short_the_grace_period():
    given = Given(grace=0.1)
    given.sources.doubt(POLICY)
    given.wait(1000)
    assert given.up == [(POLICY, LEAST)]
    assert AGAIN.after(1) + AGAIN.after(2) < LEAST


def test_a_policy_without_a_plan_has_nothing_to_give_up(given):
    given.sources.doubt(POLICY)
    given.sources.end(POLICY)
    given.sources.wait("robot/other")
    given.sources.stop()
    given.wait(1000)
    assert given.up == []
