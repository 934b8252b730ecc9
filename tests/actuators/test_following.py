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
        self.not_set: Mapping[str, str] = {}
        follow = follow_agents(self.scheduler, SETTLED, lambda: self.ahead, lambda: self.not_set)
        self.end = self.source.pipe(follow).subscribe(self.note)

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


def test_a_plan_that_has_just_settled_is_ordered_with_the_next():
    story = Story(NODE)
    story.plan(node_1=100)
    story.scheduler.sleep(SETTLED)
    story.plan(node_1=100)
    assert story.last == {NODE: 100}


def test_with_an_agent_a_plan_is_ordered_when_it_has_settled():
    story = Story(NODE)
    story.plan(node_1=100)
    story.scheduler.advance_by(HOUR)
    assert story.ordered == [(0, {}), (SETTLED, {NODE: 100})]


def test_last_order_holds_until_the_plan_settles():
    story = Story()
    story.plan(node_1=100)
    story.ahead = frozenset({NODE})
    story.plan(node_1=900)
    assert story.last == {NODE: 100}
    story.scheduler.advance_by(SETTLED)
    assert story.last == {NODE: 900}


def test_reverted_plan_orders_no_change():
    story = Story()
    story.plan(node_1=100)
    story.ahead = frozenset({NODE})
    story.plan(node_1=900)
    story.plan(node_1=100)
    story.scheduler.advance_by(2 * SETTLED)
    assert {shares[NODE] for _, shares in story.ordered} == {100}
    assert len(story.ordered) <= 4, "the timer of the plan that went may fire once"


def test_only_the_last_of_short_lived_plans_is_ordered():
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


def test_a_lost_agent_triggers_the_order_and_cancels_the_timer():
    story = Story(NODE)
    story.plan(node_1=100)
    story.ahead = frozenset()
    story.plan(node_1=100)
    assert story.last == {NODE: 100}
    story.scheduler.advance_by(HOUR)
    assert len(story.ordered) <= 3, "the timer of the plan that waited may fire once"
    assert len(story.scheduler._queue) == 0


TWO = ("robot/slam/slam", "robot/speech/speech")


class Pair(Story):
    """Two containers on the node, of which the agent could not set some."""

    def note(self, nodes):
        [self.node] = nodes.values() or [NodePlan(0, {}, {})]

    def share(self, slam, speech, suspended=(), caps=None):
        shares = dict(zip(TWO, (slam, speech), strict=True))
        self.source.on_next({NODE: NodePlan(1000, {}, shares, suspended=frozenset(suspended), caps=caps or {})})

    @property
    def shares(self):
        return tuple(self.node.containers.get(identity) for identity in TWO)


def test_a_container_the_agent_failed_to_set_is_resized_before_the_others():
    story = Pair(NODE)
    story.share(500, 500)
    story.scheduler.advance_by(SETTLED)
    story.not_set = {TWO[0]: "slam"}
    story.share(900, 100)
    assert story.shares == (900, 500)
    assert story.node.capacity == 1400, "what the agent has taken from the other pays for it"
    story.scheduler.advance_by(SETTLED)
    assert (story.shares, story.node.capacity) == ((900, 100), 1000)


def test_failed_container_is_ordered_with_every_plan():
    story = Pair(NODE)
    story.not_set = {TWO[0]: "slam"}
    for slam in (100, 900, 200):
        story.share(slam, 1000 - slam)
        assert story.shares == (slam, None)
        story.scheduler.advance_by(SETTLED / 6)


def test_a_container_the_agent_failed_to_set_does_not_change_the_others():
    story = Pair(NODE)
    story.not_set = {TWO[0]: "slam"}
    story.share(500, 500)
    story.scheduler.advance_by(SETTLED)
    for turn in range(4):
        story.share(500, 500, suspended=["slam", "speech"] if turn % 2 else ["speech"], caps={"speech": 100 + turn})
        assert story.node.suspended == (frozenset(["slam"]) if turn % 2 else frozenset())
        assert story.node.caps == {}
        story.scheduler.advance_by(SETTLED / 4)
    story.share(500, 500, suspended=["speech"], caps={"slam": 300})
    assert (story.node.suspended, story.node.caps) == (frozenset(), {"slam": 300})
    story.scheduler.advance_by(SETTLED)
    assert (story.node.suspended, story.node.caps) == (frozenset(["speech"]), {"slam": 300})


def test_recovered_container_waits_for_the_agent_again():
    story = Pair(NODE)
    story.not_set = dict(zip(TWO, ("slam", "speech"), strict=True))
    story.share(500, 500)
    story.share(900, 100)
    assert story.shares == (900, 100)
    story.not_set = {}
    story.share(200, 800)
    assert story.shares == (900, 100)
    story.scheduler.advance_by(SETTLED)
    assert story.shares == (200, 800)


def test_removed_container_is_not_ordered():
    story = Pair(NODE)
    story.not_set = dict(zip(TWO, ("slam", "speech"), strict=True))
    story.share(500, 500)
    story.source.on_next({NODE: NodePlan(1000, {}, {TWO[1]: 900})})
    assert story.shares == (None, 900)


def test_removed_node_is_not_waited_for():
    story = Story(NODE)
    story.plan(node_1=100)
    story.plan()
    story.scheduler.advance_by(HOUR)
    assert story.last == {}


def test_disposed_subscription_orders_nothing():
    story = Story(NODE)
    story.plan(node_1=100)
    story.end.dispose()
    story.scheduler.advance_by(HOUR)
    assert story.ordered == [(0, {})]
