"""One policy over time: what is evaluated, what is emitted, what is held back."""

from __future__ import annotations

import gc
import weakref
from collections import Counter

import pytest

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Score
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.cel import Expression
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task, on_node
from tests.planning.quiet import Quiet
from tests.planning.two_streams import two_streams


@pytest.fixture
def evaluated(monkeypatch):
    """How often each expression was evaluated, by source."""
    counts: Counter[str] = Counter()
    evaluate = Expression.evaluate

    def counting(expression, scope):
        counts[expression.source] += 1
        return evaluate(expression, scope)

    monkeypatch.setattr(Expression, "evaluate", counting)
    return counts


def test_a_planner_that_is_replaced_is_freed():
    """CEL's contexts are not Python's: a cycle through one is never collected, and each edit makes a new planner."""
    planner = Planner(two_streams(), Quiet(), {})
    planner.start(START)
    gone = weakref.ref(planner)
    del planner
    gc.collect()
    assert gone() is None


def test_a_sample_evaluates_only_what_reads_its_stream(evaluated):
    story = Story(two_streams())
    evaluated.clear()
    story.sample("mic", at=1, level=0.0)
    assert evaluated == {"mic.level > 0.1": 1, "mic.level > 0.05": 1, "imu.speed > 0.3 && mic.level > 0.3": 1}
    evaluated.clear()
    story.sample("imu", at=2, speed=0.0)
    assert evaluated == {"imu.speed > 0.1": 1, "imu.speed > 0.2": 1, "imu.speed > 0.3 && mic.level > 0.3": 1}


def test_passing_time_evaluates_no_expressions(evaluated):
    story = Story(two_streams())
    story.sample("imu", at=1, speed=1.0)
    evaluated.clear()
    story.wait(1e6)
    assert evaluated == {}


def test_a_plan_equal_to_the_last_is_not_emitted():
    story = Story(two_streams())
    for tick in range(1, 50):
        story.sample("imu", at=tick, speed=1.0 + tick)
    assert [plan.time for plan in story.plans] == [START, START, START + 1]


def test_an_invisible_change_makes_no_plan():
    """The weaker of two activities begins."""
    activities = [{"when": "imu.near", "score": 5}, {"when": "imu.far"}]
    story = Story(a_policy(streams=[a_stream("imu")], tasks=[a_task("slam", activity=activities), a_task("rest")]))
    story.sample("imu", at=1, near=True, far=False)
    story.sample("imu", at=2, near=True, far=True)
    story.sample("imu", at=3, near=False, far=True)
    assert [plan.time for plan in story.plans[-2:]] == [START + 1, START + 3]


def test_a_plan_shows_when_the_sample_that_made_it_arrived_and_no_other_does():
    holding = {"tasks": [a_task("slam", activity=[{"when": "imu.speed > 0.1", "hold": "500ms"}]), a_task("rest")]}
    story = Story(a_policy(streams=[a_stream("imu")], **holding))
    story.sample("imu", at=1, arrived=7.0, speed=1.0)
    story.sample("imu", at=1.1, arrived=7.1, speed=0.0)
    story.sample("imu", at=5, arrived=11.0, speed=0.0)
    story.place(on_node("slam", "rest", cores=2), at=6)
    assert [(round(plan.time - START, 3), plan.arrived) for plan in story.plans] == [
        (0, None),
        (0, None),
        (1, 7.0),
        (1.5, None),
        (6, None),
    ]


def test_a_plan_that_was_held_back_is_made_by_its_dwell_and_no_sample():
    spec = {
        "streams": [a_stream("imu")],
        "tasks": [a_task("slam", activity=[{"scoreFrom": "imu.risk"}]), a_task("rest")],
    }
    story = Story(a_policy(enforcement={"minDwell": "1s"}, **spec))
    story.sample("imu", at=0.5, arrived=7.0, risk=4.0)
    story.wait(2.0)
    made = {plan.sequence: plan for plan in reversed(story.plans)}
    assert [(round(made[n].time - START, 3), made[n].arrived) for n in (1, 2, 3)] == [(0, None), (0, None), (1, None)]


def test_a_score_that_changes_no_share_is_reported_and_not_carried_out():
    policy = a_policy(streams=[a_stream("imu")], tasks=[a_task("slam", activity=[{"scoreFrom": "imu.risk"}])])
    story = Story(policy)
    for tick in range(1, 5):
        story.sample("imu", at=tick, risk=float(max(2, tick)))
    shown = [(plan.sequence, plan.time - START, plan.tasks["slam"].weight, plan.cause) for plan in story.plans[2:]]
    assert shown == [(3, 1, 2.0, "imu: true is 2"), (3, 3, 3.0, "imu: true is 3"), (3, 4, 4.0, "imu: true is 4")]
    assert story.planner.decided == story.plans[2]
    assert story.planner.last == story.plans[-1]


def test_equal_placements_change_nothing_and_new_ones_do():
    story = Story(two_streams())
    story.place(on_node("slam", "speech", "rest"), at=1)
    story.place(on_node("slam", "speech", "rest"), at=2)
    story.place(on_node("slam", "rest"), at=3)
    assert [plan.time - START for plan in story.plans] == [0, 0, 3]


class TestNothingActive:
    def story(self, **task):
        policy = a_policy(
            streams=[a_stream("imu"), a_stream("mic")],
            tasks=[
                a_task("slam", priority=3, activity=[{"when": "imu.moves"}]),
                a_task("speech", activity=[{"when": "mic.loud"}]),
                a_task("arm", priority=5, activity=[{"when": "imu.moves"}]) | task,
            ],
            contexts=[a_context("quiet", "mic.quiet", tasks={"arm": {"suspend": True}})],
        )
        story = Story(policy)
        story.sample("mic", at=1, loud=False, quiet=True)
        return story

    def test_those_that_are_not_suspended_divide_the_node_by_priority(self):
        story = self.story()
        assert story.shares() == {"slam": 740, "speech": 250, "arm": 10}

    def test_the_plan_distinguishes_suspended_and_resting_tasks(self):
        story = self.story()
        assert {name: task.suspended for name, task in story.last.tasks.items()} == {
            "slam": False,
            "speech": False,
            "arm": True,
        }
        assert story.last.tasks["slam"].because == "nothing is active, so priorities divide the node"
        assert story.last.tasks["arm"].because == "context quiet suspends it"
        assert story.last.nodes["robot"].basis == "Priority"

    def test_the_first_activity_ends_it(self):
        story = self.story()
        story.sample("imu", at=2, moves=True)
        assert story.shares() == {"slam": 980, "speech": 10, "arm": 10}
        assert story.last.tasks["speech"].suspended

    def test_a_task_of_priority_zero_still_gets_the_least(self):
        assert self.story(priority=0).shares()["arm"] == 10


@pytest.mark.parametrize(
    "event",
    [
        Sample("nobody", {}),
        Sample("imu", {}),
        Sample("imu", {"speed": 10**400}),
        Sample("imu", {"speed": {"speed": []}}),
        Sample("imu", {"speed": "\ud800"}),
        Sample("imu", {"speed": float("nan")}, float("nan")),
        Sample("imu", {"speed": 1.0}, 1e300),
        Score("slam", 0, float("nan")),
    ],
    ids=repr,
)
def test_invalid_input_never_raises_and_keeps_the_last_plan(event):
    story = Story(two_streams())
    last = story.last
    story.take(event, at=1)
    story.take(event, at=0.5)
    assert story.last.nodes == last.nodes or event == Sample("imu", {"speed": 1.0}, 1e300)
    assert story.planner.drops
