"""Scores become weights: priorities, the task graph, what suspends whom."""

from __future__ import annotations

import pytest

from contextpolicy.planning.allocation.weights import HEAVIEST, Obstacles, Weigher
from tests.planning.builders import a_context, a_parent, a_policy, a_task


def weights(policy, contexts=(), waiting=None, **scores):
    all_scores = {task.name: scores.get(task.name, 1.0) for task in policy.tasks}
    active = [context for context in policy.contexts if context.name in contexts]
    return Weigher(policy).weigh(all_scores, Obstacles(waiting or {}), active)


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


def test_a_resting_subtask_explains_its_own_reason():
    got = weights(a_graph("All"), transcript=0.0)
    assert got["transcript"].because == "part of speech's 6; priority 2 times score 0"
    got = weights(a_graph("All"), transcript=0.0, keyword=0.0)
    assert got["transcript"].because == "priority 2 times score 0"
    got = weights(a_graph("All"), speech=0.0)
    assert got["transcript"].because == "speech: priority 6 times score 0"


def test_weights_follow_contexts_that_begin_and_end():
    policy = a_graph("Any", a_context("talk", tasks={"keyword": {"weight": 5}, "slam": {"scale": 2}}))
    weigher, scores = Weigher(policy), {task.name: 1.0 for task in policy.tasks}
    for contexts in ((), policy.contexts, ()):
        again = weigher.weigh(scores, Obstacles({}), contexts)
        assert again == Weigher(policy).weigh(scores, Obstacles({}), contexts)


def test_no_score_or_scale_makes_a_weight_too_large_to_add():
    policy = a_policy(tasks=[a_task("slam")], contexts=[a_context("busy", tasks={"slam": {"scale": 2}})])
    assert values(policy, contexts=["busy"], slam=1e300) == {"slam": HEAVIEST}


SUSPENDED = {"speech": 0.0, "keyword": 0.0, "transcript": 0.0, "slam": 10.0}


def test_a_compound_waits_for_the_preconditions_of_all_its_subtasks():
    got = weights(a_graph("All"), waiting={"transcript": "keyword.heard"})
    assert {name: weight.value for name, weight in got.items()} == SUSPENDED
    assert got["speech"].because == "needs all its subtasks; transcript: waits for keyword.heard"
    assert got["keyword"].because == "speech: needs all its subtasks; transcript: waits for keyword.heard"
    assert [name for name, weight in got.items() if not weight.able] == ["speech", "keyword", "transcript"]


def test_a_complex_task_continues_with_the_subtasks_that_can_run():
    got = values(a_graph("Any"), waiting={"transcript": "keyword.heard"})
    assert got == {"speech": 6.0, "keyword": 6.0, "transcript": 0.0, "slam": 10.0}


@pytest.mark.parametrize("effect", [{"suspend": True}, {"weight": 0}, {"scale": 0}])
def test_suspending_one_step_of_a_compound_suspends_all_of_it(effect):
    policy = a_graph("All", a_context("quiet", tasks={"keyword": effect}))
    got = weights(policy, contexts=["quiet"])
    assert {name: weight.value for name, weight in got.items()} == SUSPENDED
    assert got["transcript"].because == "speech: needs all its subtasks; keyword: context quiet suspends it"


def test_a_task_without_a_pod_is_suspended():
    policy = a_graph("All")
    scores = {task.name: 1.0 for task in policy.tasks}
    for satisfied_by, expected in (("All", SUSPENDED), ("Any", {**SUSPENDED, "speech": 6.0, "transcript": 6.0})):
        got = Weigher(a_graph(satisfied_by)).weigh(scores, Obstacles({}, frozenset({"keyword"})), [])
        assert {name: weight.value for name, weight in got.items()} == expected
        assert got["keyword"].because == "has no running pod"


def a_deep_graph(**leaf):
    return a_policy(
        tasks=[
            a_parent("assist", "talk", "arm", priority=12),
            a_parent("talk", "hear", "face", priority=2, satisfiedBy="Any"),
            a_parent("hear", "keyword", "transcript"),
            a_task("keyword", **leaf),
            a_task("transcript", priority=3),
            a_task("face"),
            a_task("arm"),
        ],
        contexts=[
            a_context("quiet", tasks={"transcript": {"suspend": True}}),
            a_context("still", tasks={"arm": {"suspend": True}}),
            a_context("off", tasks={"assist": {"suspend": True}}),
        ],
    )


def test_a_weight_goes_down_through_all_levels():
    assert values(a_deep_graph()) == {
        "assist": 12.0,
        "talk": 8.0,
        "arm": 4.0,
        "hear": 4.0,
        "face": 4.0,
        "keyword": 1.0,
        "transcript": 3.0,
    }


def test_inability_goes_up_to_the_first_complex_task():
    got = values(a_deep_graph(), contexts=["quiet"])
    assert got == {"assist": 12.0, "talk": 8.0, "arm": 4.0, "hear": 0, "keyword": 0, "transcript": 0, "face": 8.0}


def test_inability_below_a_chain_of_compounds_suspends_all_of_it():
    assert not any(values(a_deep_graph(), contexts=["still"]).values())


def test_parts_at_rest_on_several_levels_pass_their_weight_on():
    got = values(a_deep_graph(), keyword=0.0, transcript=0.0)
    assert (got["hear"], got["face"], got["arm"]) == (0.0, 8.0, 4.0)
    assert not any(values(a_deep_graph(), keyword=0.0, transcript=0.0, face=0.0, arm=0.0).values())


def test_a_required_task_must_be_able_to_run_with_all_that_it_is_a_part_of():
    policy = a_policy(
        tasks=[
            a_task("navigation", requires=[{"task": "localisation"}]),
            a_parent("map", "localisation", "camera"),
            a_task("localisation"),
            a_task("camera"),
        ],
        contexts=[a_context("dark", tasks={"camera": {"suspend": True}})],
    )
    assert values(policy, localisation=0.0)["navigation"] == 1.0
    got = weights(policy, contexts=["dark"])
    assert got["navigation"].value == 0
    assert got["navigation"].because == (
        "waits for task localisation; map: needs all its subtasks; camera: context dark suspends it"
    )


class TestProtected:
    @pytest.mark.parametrize("effect", [{"suspend": True}, {"weight": 0}, {"scale": 0}])
    def test_no_context_suspends_it(self, effect):
        policy = a_policy(
            tasks=[a_task("brake", priority=5, protected=True), a_task("slam")],
            contexts=[a_context("busy", tasks={"brake": {"weight": 3}}), a_context("off", tasks={"brake": effect})],
        )
        assert values(policy, contexts=["off"])["brake"] == 5.0
        assert values(policy, contexts=["busy", "off"])["brake"] == 3.0

    @pytest.mark.parametrize("context", ["still", "off"])
    def test_no_parent_suspends_it(self, context):
        got = weights(a_deep_graph(protected=True, priority=7), contexts=[context])
        part = values(a_deep_graph(protected=True, priority=7))["keyword"]
        assert {name: weight.value for name, weight in got.items() if weight.value} == {"keyword": part}
        assert (
            got["keyword"].because
            == "protected, so it continues without hear; part of hear's 4; priority 7 times score 1"
        )

    def test_suspending_its_group_does_not_raise_its_weight(self):
        """Its own priority orders it among its siblings only: beside other groups it would be another number."""
        policy = a_policy(
            tasks=[
                a_parent("drive", "brake", "plan", priority=1),
                a_task("brake", priority=8, protected=True),
                a_task("plan", priority=2),
                a_task("slam", priority=1),
            ],
            contexts=[a_context("off", tasks={"drive": {"suspend": True}})],
        )
        assert values(policy)["brake"] == values(policy, contexts=["off"])["brake"] == 0.8

    def test_it_rests_with_a_parent_that_rests(self):
        got = weights(a_deep_graph(protected=True, priority=7), hear=0.0)
        assert (got["keyword"].value, got["keyword"].able) == (0.0, True)


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
        a_context("hailed", tasks={"keyword": {"suspend": False}}),
    )
    assert values(policy, contexts=["moving", "hailed"])["keyword"] == 2.0


def test_a_context_sets_a_parents_weight_and_the_split_follows():
    policy = a_graph("All", a_context("hailed", tasks={"speech": {"weight": 30}}))
    assert values(policy, contexts=["hailed"]) == {"speech": 30.0, "keyword": 10.0, "transcript": 20.0, "slam": 10.0}


class TestContextsInListOrder:
    """Weight replaces, scale multiplies what is there, and only `suspend: false` takes a suspension back."""

    @pytest.mark.parametrize(
        ("effects", "expected"),
        [
            ([{"suspend": True}, {"scale": 2}], 0.0),
            ([{"suspend": True}, {"weight": 8}], 0.0),
            ([{"weight": 0}, {"weight": 8}], 0.0),
            ([{"weight": 8}, {"scale": 0.5}], 4.0),
            ([{"scale": 2}, {"scale": 0.25}], 2.5),
            ([{"scale": 2}, {"weight": 8}], 8.0),
            ([{"weight": 8}, {"suspend": True}, {"scale": 0.5}, {"suspend": False}], 4.0),
            ([{"suspend": True}, {"suspend": False}], 5.0),
            ([{"suspend": False}, {"suspend": True}], 0.0),
            ([{"scale": 0}, {"suspend": False}, {"scale": 2}], 10.0),
            ([{"suspend": True}, {"suspend": False, "weight": 8}], 8.0),
            ([{"weight": 0}, {"suspend": False, "scale": 2}], 10.0),
        ],
    )
    def test_effects_apply_in_list_order(self, effects, expected):
        contexts = [a_context(f"c{i}", tasks={"slam": effect}) for i, effect in enumerate(effects)]
        policy = a_policy(tasks=[a_task("slam", priority=5)], contexts=contexts)
        got = weights(policy, contexts=[context["name"] for context in contexts])["slam"]
        assert (got.value, got.able) == (expected, expected > 0)

    def test_the_reason_names_all_that_count(self):
        contexts = [a_context(f"c{i}", tasks={"slam": e}) for i, e in enumerate([{"weight": 8}, {"scale": 0.5}])]
        policy = a_policy(tasks=[a_task("slam")], contexts=contexts)
        got = weights(policy, contexts=["c0", "c1"])["slam"]
        assert got.because == "context c0 sets its weight to 8, context c1 scales its weight by 0.5"

    def test_unsuspending_a_part_does_not_unsuspend_its_group(self):
        contexts = [
            a_context("off", tasks={"speech": {"suspend": True}}),
            a_context("on", tasks={"keyword": {"suspend": False}}),
        ]
        assert not values(a_graph("Any", *contexts), contexts=["off", "on"])["keyword"]
