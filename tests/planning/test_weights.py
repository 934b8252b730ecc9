"""Scores become weights: priorities, the task graph, what suspends whom."""

from __future__ import annotations

import pytest

from contextpolicy.planning.weights import Weigher
from tests.planning.builders import a_context, a_parent, a_policy, a_task


def weights(policy, contexts=(), waiting=None, **scores):
    all_scores = {task.name: scores.get(task.name, 1.0) for task in policy.tasks}
    active = [context for context in policy.contexts if context.name in contexts]
    return Weigher(policy).weigh(all_scores, waiting or {}, active)


def values(policy, contexts=(), waiting=None, **scores):
    return {name: weight.value for name, weight in weights(policy, contexts, waiting, **scores).items()}


def a_graph(satisfied_by, *contexts):
    """Speech with its two steps (paper, Fig. 2) beside slam."""
    return a_policy(
        tasks=[
            a_parent("speech", "keyword", "transcript", priority=6, satisfiedBy=satisfied_by),
            a_task("keyword"),
            a_task("transcript", priority=2),
            a_task("slam", priority=10),
        ],
        contexts=list(contexts),
    )


def test_an_elemental_task_weighs_priority_times_score():
    policy = a_policy(tasks=[a_task("slam", priority=10), a_task("speech", priority=0.5)])
    assert values(policy, slam=2.0, speech=3.0) == {"slam": 20.0, "speech": 1.5}


@pytest.mark.parametrize("satisfied_by", ["All", "Any"])
def test_a_parents_weight_is_split_over_its_subtasks_in_proportion(satisfied_by):
    assert values(a_graph(satisfied_by)) == {"speech": 6.0, "keyword": 2.0, "transcript": 4.0, "slam": 10.0}


@pytest.mark.parametrize("satisfied_by", ["All", "Any"])
def test_a_subtask_that_waits_leaves_its_part_to_the_others(satisfied_by):
    """The transcript needs a keyword first; until then keyword spotting has all of speech's weight."""
    got = values(a_graph(satisfied_by), waiting={"transcript": "keyword.heard"})
    assert got == {"speech": 6.0, "keyword": 6.0, "transcript": 0.0, "slam": 10.0}


@pytest.mark.parametrize("effect", [{"suspend": True}, {"weight": 0}])
def test_suspending_one_step_of_a_compound_suspends_all_of_it(effect):
    policy = a_graph("All", a_context("quiet", tasks={"keyword": effect}))
    got = weights(policy, contexts=["quiet"])
    assert {name: weight.value for name, weight in got.items()} == {
        "speech": 0.0,
        "keyword": 0.0,
        "transcript": 0.0,
        "slam": 10.0,
    }
    assert got["transcript"].because == "speech needs all its subtasks and keyword is suspended"


def test_suspending_one_step_of_a_complex_task_leaves_its_part_to_the_others():
    policy = a_graph("Any", a_context("quiet", tasks={"keyword": {"suspend": True}}))
    assert values(policy, contexts=["quiet"]) == {"speech": 6.0, "keyword": 0.0, "transcript": 6.0, "slam": 10.0}


def test_suspending_the_parent_suspends_its_subtasks_and_says_so():
    """Fig. 4: while the robot moves, no microphone-related task runs."""
    policy = a_graph("All", a_context("moving", tasks={"speech": {"suspend": True}}))
    got = weights(policy, contexts=["moving"])
    assert [got[name].value for name in ("speech", "keyword", "transcript")] == [0.0, 0.0, 0.0]
    assert got["keyword"].because == "speech: context moving suspends it"


def test_a_parent_without_a_runnable_subtask_has_no_weight():
    got = weights(a_graph("Any"), waiting={"transcript": "a", "keyword": "b"})
    assert [got[name].value for name in ("speech", "keyword", "transcript")] == [0.0, 0.0, 0.0]
    assert got["speech"].because == "no subtask can run; keyword: waits for b"


def test_a_parent_that_waits_suspends_its_subtasks():
    got = weights(a_graph("All"), waiting={"speech": "mic.level > 0.1"})
    assert got["keyword"].because == "speech: waits for mic.level > 0.1"


def test_a_later_context_can_take_a_suspension_back():
    policy = a_graph(
        "All",
        a_context("moving", tasks={"keyword": {"suspend": True}}),
        a_context("hailed", tasks={"keyword": {"scale": 1}}),
    )
    assert values(policy, contexts=["moving", "hailed"])["keyword"] == 2.0


def test_a_context_sets_a_parents_weight_and_the_split_follows():
    policy = a_graph("All", a_context("hailed", tasks={"speech": {"weight": 30}}))
    assert values(policy, contexts=["hailed"]) == {"speech": 30.0, "keyword": 10.0, "transcript": 20.0, "slam": 10.0}
