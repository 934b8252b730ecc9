"""When resizes follow an agent: settled plans only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reactivex import Subject
from reactivex.testing import TestScheduler

from contextpolicy.actuators.following import SETTLED, follow_agents
from contextpolicy.planning.allocation.plan import NodePlan

if TYPE_CHECKING:
    from collections.abc import Mapping

NODE, OTHER = "node-1", "node-2"
HOUR = 3600


def a_plan(share):
    return NodePlan(1000, {"slam": share}, {"robot/slam/slam": share})


class Story:
    """`ordered` has what was ordered, with its time: the share of `slam` by node."""

    def __init__(self, *ahead):
        self.scheduler = TestScheduler()
        self.ordered: list[tuple[float, dict[str, int]]] = []
        self.source: Subject[Mapping[str, NodePlan]] = Subject()
        self.ahead = frozenset(ahead)
        self.end = self.source.pipe(follow_agents(self.scheduler, lambda: self.ahead)).subscribe(self.note)

    def note(self, nodes):
        now = round(self.scheduler.to_seconds(self.scheduler.now), 3)
        self.ordered.append((now, {node: plan.shares["slam"] for node, plan in nodes.items()}))

    def plan(self, **shares):
        """`node_1=900` and the like."""
        self.source.on_next({node.replace("_", "-"): a_plan(share) for node, share in shares.items()})

    @property
    def last(self):
        return self.ordered[-1][1]


def test_without_an_agent_every_plan_is_ordered_at_once():
    story = Story()
    for share in (100, 900, 100):
        story.plan(node_1=share)
    story.scheduler.advance_by(HOUR)
    assert story.ordered == [(0, {NODE: 100}), (0, {NODE: 900}), (0, {NODE: 100})]


def test_with_an_agent_a_plan_is_ordered_when_it_has_settled():
    story = Story(NODE)
    story.plan(node_1=100)
    story.scheduler.advance_by(HOUR)
    assert story.ordered == [(0, {}), (SETTLED, {NODE: 100})]


def test_until_then_the_last_order_holds():
    story = Story()
    story.plan(node_1=100)
    story.ahead = frozenset({NODE})
    story.plan(node_1=900)
    assert story.last == {NODE: 100}
    story.scheduler.advance_by(SETTLED)
    assert story.last == {NODE: 900}


def test_a_plan_that_goes_and_comes_back_is_no_change():
    story = Story()
    story.plan(node_1=100)
    story.ahead = frozenset({NODE})
    story.plan(node_1=900)
    story.plan(node_1=100)
    story.scheduler.advance_by(2 * SETTLED)
    assert {shares[NODE] for _, shares in story.ordered} == {100}
    assert len(story.ordered) <= 4, "the timer of the plan that went may fire once"


def test_of_plans_that_do_not_last_only_the_last_is_ordered_however_long_they_go_on():
    story = Story(NODE)
    for step in range(HOUR):
        story.plan(node_1=1 + step)
        story.scheduler.advance_by(1)
    story.scheduler.advance_by(SETTLED)
    assert {shares[NODE] for _, shares in story.ordered if shares} == {HOUR}


def test_nodes_do_not_wait_for_each_other():
    story = Story(NODE)
    story.plan(node_1=100, node_2=200)
    assert story.last == {OTHER: 200}


def test_when_the_agent_is_gone_the_plan_is_ordered_at_once_and_no_timer_goes_on():
    story = Story(NODE)
    story.plan(node_1=100)
    story.ahead = frozenset()
    story.plan(node_1=100)
    assert story.last == {NODE: 100}
    story.scheduler.advance_by(HOUR)
    assert len(story.ordered) <= 3, "the timer of the plan that waited may fire once"
    assert len(story.scheduler._queue) == 0


def test_a_node_that_is_gone_is_not_waited_for():
    story = Story(NODE)
    story.plan(node_1=100)
    story.plan()
    story.scheduler.advance_by(HOUR)
    assert story.last == {}


def test_nothing_is_ordered_after_the_end_of_the_subscription():
    story = Story(NODE)
    story.plan(node_1=100)
    story.end.dispose()
    story.scheduler.advance_by(HOUR)
    assert story.ordered == [(0, {})]
