"""When resizes follow an agent: settled plans only, and never too late."""

from __future__ import annotations

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.actuators.following import LONGEST, SETTLED, Follower
from contextpolicy.planning.allocation.plan import NodePlan

NODE, OTHER = "node-1", "node-2"
AHEAD = frozenset({NODE})


def a_plan(share):
    return NodePlan(1000, {"slam": share}, {"robot/slam/slam": share})


@pytest.fixture
def scheduler():
    return TestScheduler()


@pytest.fixture
def calls():
    return []


@pytest.fixture
def follower(scheduler, calls):
    return Follower(scheduler, lambda: calls.append(round(scheduler.to_seconds(scheduler.now), 3)))


def test_without_an_agent_every_plan_is_ordered_at_once(follower, calls):
    for share in (100, 900, 100):
        assert follower.choose({NODE: a_plan(share)}, frozenset()) == {NODE: a_plan(share)}
    assert calls == []


def test_with_an_agent_a_plan_is_ordered_when_it_has_settled(follower, scheduler, calls):
    assert follower.choose({NODE: a_plan(100)}, AHEAD) == {}
    scheduler.advance_by(SETTLED)
    assert calls == [SETTLED]
    assert follower.choose({NODE: a_plan(100)}, AHEAD) == {NODE: a_plan(100)}


def test_until_then_the_last_order_holds(follower, scheduler):
    follower.choose({NODE: a_plan(100)}, frozenset())
    assert follower.choose({NODE: a_plan(900)}, AHEAD) == {NODE: a_plan(100)}
    scheduler.advance_by(SETTLED)
    assert follower.choose({NODE: a_plan(900)}, AHEAD) == {NODE: a_plan(900)}


def test_a_plan_that_goes_and_comes_back_is_no_change(follower, scheduler, calls):
    follower.choose({NODE: a_plan(100)}, frozenset())
    follower.choose({NODE: a_plan(900)}, AHEAD)
    follower.choose({NODE: a_plan(100)}, AHEAD)
    scheduler.advance_by(2 * SETTLED)
    assert follower.choose({NODE: a_plan(100)}, AHEAD) == {NODE: a_plan(100)}
    assert len(calls) <= 1


def test_a_storm_is_followed_from_time_to_time(follower, scheduler):
    follower.choose({NODE: a_plan(0)}, frozenset())
    ordered = set()
    for step in range(round(2.5 * LONGEST / SETTLED * 5)):
        scheduler.advance_by(SETTLED / 5)
        ordered.add(follower.choose({NODE: a_plan(1 + step)}, AHEAD)[NODE].shares["slam"])
    assert len(ordered) == 1 + 2


def test_nodes_do_not_wait_for_each_other(follower):
    plans = {NODE: a_plan(100), OTHER: a_plan(200)}
    assert follower.choose(plans, AHEAD) == {OTHER: a_plan(200)}


def test_when_the_agent_is_gone_the_plan_is_ordered_at_once(follower):
    follower.choose({NODE: a_plan(100)}, AHEAD)
    assert follower.choose({NODE: a_plan(100)}, frozenset()) == {NODE: a_plan(100)}


def test_a_stopped_follower_orders_nothing(follower, scheduler, calls):
    follower.choose({NODE: a_plan(100)}, AHEAD)
    follower.stop()
    scheduler.advance_by(LONGEST)
    assert calls == []
