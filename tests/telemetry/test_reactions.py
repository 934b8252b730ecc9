"""Which resize is the reaction to which sample."""

from __future__ import annotations

import pytest

from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Scheduler
from contextpolicy.telemetry.reactions import Reactions
from tests.planning.builders import a_plan

POLICY = "lab/robot"


@pytest.fixture
def reactions():
    """The robot stands: slam and speech have the same, as no sample had it."""
    standing = Reactions()
    standing.plan(POLICY, a_plan(1, {"slam": 500, "speech": 500}), 0.0)
    return standing


def reached(reactions, container, limit, *, request=10):
    """When the samples came whose reactions these are, by stage."""
    reaching = (reactions.reach(POLICY, container, stage, Cpu(request, limit)) for stage in ("patch", "status"))
    return [reaction.arrived if reaction else None for reaction in reaching]


def test_each_stage_of_what_a_sample_changed_is_measured_once(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "slam", 900) == [7.0, 7.0]
    assert reached(reactions, "slam", 900) == [None, None]
    assert reached(reactions, "speech", 100) == [7.0, 7.0]


def test_what_the_plan_left_alone_is_no_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 400, "speech": 500}, arrived=7.0), 7.5)
    assert reached(reactions, "speech", 500) == [None, None]


def test_a_limit_on_the_way_or_of_an_older_plan_is_not_what_the_sample_asked_for(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 700, "speech": 300}, arrived=8.0), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]
    assert reached(reactions, "slam", 700) == [8.0, 8.0]


def test_requests_count_where_they_are_what_moves(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    assert reactions.reach(POLICY, "slam", "patch", Cpu(900, 1000)).arrived == 7.0


def test_a_later_plan_leaves_under_way_what_it_does_not_change(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 900, "speech": 50}, arrived=8.0), 7.5)
    assert reached(reactions, "slam", 900) == [7.0, 7.0]


def test_a_plan_of_a_timer_ends_what_it_changes(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 500}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 500, "speech": 500}), 7.5)
    reactions.plan(POLICY, a_plan(4, {"slam": 900, "speech": 500}), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]


def test_the_first_plan_of_a_run_may_change_nothing(reactions):
    """What the containers had is not known: an equal limit is never asked for, and an hour later it might be."""
    reactions.plan(POLICY, a_plan(1, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]


def test_a_new_container_got_its_share_because_it_came(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 500, "speech": 500, "planner": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "planner", 100) == [None, None]


def test_what_somebody_else_changed_is_put_back_for_no_sample(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    reactions.drop(POLICY, "slam")
    assert reached(reactions, "slam", 900) == [None, None]


def test_realtime_is_not_resized(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 400}, arrived=7.0, scheduler=Scheduler.REALTIME), 7.5)
    assert reached(reactions, "slam", 400) == [None, None]


def test_a_policy_that_is_gone_leaves_nothing(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    reactions.forget(POLICY)
    reactions.drop(POLICY, "slam")
    assert reached(reactions, "slam", 900) == [None, None]
