"""What people read, of what a planner knows; tests/commands/test_explain.py has whole runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import sentences
from contextpolicy.planning.conditions.sample import Sample
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task, on_node, together


def explained(task, placement):
    tasks = [a_task("slam", priority=3), a_task("speech")]
    policy = a_policy(streams=[a_stream("imu")], tasks=tasks, enforcement={"scheduler": "Realtime"}, reserve="0")
    return sentences(explain(Story(policy, placement).planner, START + 1), task)


def test_context_effects_and_protection_are_explained():
    tasks = [a_task("brake", protected=True), a_task("slam")]
    contexts = [
        a_context("busy", "true", tasks={"brake": {"weight": 3}, "slam": {"weight": 2}}),
        a_context("off", "true", tasks={"brake": {"suspend": True}, "slam": {"scale": 0}}),
    ]
    policy = a_policy(tasks=tasks, contexts=contexts)
    explanation = explain(Story(policy, on_node("brake", "slam")).planner, START + 1)["tasks"]
    assert {name: own["protected"] for name, own in explanation.items()} == {"brake": True, "slam": False}
    effects = {
        name: [(e["context"], e["decides"], e["ruledOut"]) for e in own["effects"]] for name, own in explanation.items()
    }
    assert effects == {
        "brake": [("busy", True, False), ("off", False, True)],
        "slam": [("busy", False, False), ("off", True, False)],
    }


def test_a_suspension_outlasts_later_weights_until_a_context_lets_the_task_run():
    effects = [{"weight": 8}, {"suspend": True}, {"scale": 0.5}, {"suspend": False}]

    def reported(count):
        contexts = [a_context(f"c{i}", "true", tasks={"slam": effect}) for i, effect in enumerate(effects[:count])]
        policy = a_policy(tasks=[a_task("slam")], contexts=contexts)
        said = sentences(explain(Story(policy, on_node("slam")).planner, START + 1), "slam")
        return [sentence for sentence in said if sentence.startswith(("Context", "So "))]

    assert reported(3) == [
        "Context c0 sets its weight to 8, but another context decides.",
        "Context c1 suspends it.",
        "Context c2 scales its weight by 0.5, but another context decides.",
        "So its weight is 0.",
    ]
    assert reported(4) == [
        "Context c0 sets its weight to 8.",
        "Context c1 suspends it, but another context decides.",
        "Context c2 scales its weight by 0.5.",
        "Context c3 lets it run.",
        "So its weight is 4.",
    ]


@pytest.fixture
def two_nodes():
    """One is in realtime, the other can't be."""
    able, unable = on_node("slam", "speech", node="able"), on_node("slam", "speech", cores=20, node="unable")
    return replace(together(able, unable), fair_only=frozenset({"unable"}))


def test_a_node_in_realtime_is_divided_by_eq_2():
    reported = explained("slam", on_node("slam", "speech", cores=2))
    assert reported[0] == "slam gets 1426m on node robot."
    assert reported[-2:] == [
        "Eq. 2 on node robot: 1900m * 3 / 4 = 1425m.",
        "Rounded to steps of 2m, its share is 1426m.",
    ]


def test_a_deadline_in_realtime_is_that_of_a_thread_on_one_of_the_processors():
    tasks = [a_task("slam", min=2, needs={"cores": 2, "deadline": "60ms"}), a_task("rest", priority=9)]
    story = Story(a_policy(tasks=tasks, enforcement={"scheduler": "Realtime"}), on_node("slam", "rest", cores=4))
    needs = explain(story.planner, START + 1)["tasks"]["slam"]["needs"]
    assert [(need["given"], need["met"]) for need in needs] == [(2000, True), (pytest.approx(0.05), True)]


def test_a_node_that_fell_back_is_divided_by_eq_1(two_nodes):
    reported = explained("slam", two_nodes)
    assert reported[0] == "slam gets 713m on node able and 15000m on node unable."
    assert [one for one in reported if one.startswith("Eq.")] == [
        "Eq. 2 on node able: 950m * 3 / 4 = 712.5m.",
        "Eq. 1 on node unable: 20000m * 3 / 4 = 15000m.",
    ]


def enforced(control, task="slam", **more):
    """The sentences about what a share means: all between the one about the plan and the one about the score."""
    tasks = [a_task("slam"), a_task("brake", protected=True, priority=0.2), a_task("speech")]
    contexts = [a_context("quiet", "true", tasks={"speech": {"suspend": True}})]
    policy = a_policy(tasks=tasks, contexts=contexts, enforcement={"control": control, **more})
    reported = sentences(explain(Story(policy, on_node("slam", "brake", "speech")).planner, START + 1), task)
    return reported[2 : next(place for place, one in enumerate(reported) if one.startswith("Its score"))]


def test_a_share_is_a_cap_only_under_limit():
    assert enforced("Limit") == []
    assert enforced("Suspend") == [
        "That is informative only: control Suspend leaves a running task its original limit, up to its max."
    ]
    assert enforced("Weight") == [
        "That is its weight where CPU is contested (control Weight); it may also use what others leave idle."
    ]
    assert enforced("Weight", scheduler="Realtime") == []


@pytest.mark.parametrize("control", ["Suspend", "Weight", "Limit"])
def test_a_suspended_task_is_capped_under_every_control(control):
    assert enforced(control, "speech") == []


def test_a_protected_task_weighs_at_least_a_core():
    assert enforced("Weight", "brake")[1:] == [
        "It is protected, so beside the other tasks its weight is 1000m: small weights wait long."
    ]


def test_decaying_activity_is_not_in_force():
    activity = {"when": "imu.hit", "score": 10, "hold": "1s", "decay": "10s", "until": "imu.calm"}
    tasks = [a_task("slam", activity=[activity], idle=5), a_task("rest")]
    story = Story(a_policy(streams=[a_stream("imu")], tasks=tasks))
    story.sample("imu", at=1, hit=True, calm=False)

    def reported(at):
        story.wait(at)
        said = sentences(explain(story.planner, START + at), "slam")
        return [one for one in said if one.startswith(("Activity", "Its idle"))]

    assert reported(1.5) == ["Activity `imu.hit` on imu is in force with score 10 until `imu.calm`."]
    assert reported(5) == ["Activity `imu.hit` on imu is over: its score has decayed from 10 to 7."]
    assert reported(8) == [
        "Activity `imu.hit` on imu is over: its score has decayed from 10 to 4.",
        "Its idle score, 5, is higher.",
    ]


@pytest.mark.parametrize(
    ("when", "shown"),
    [
        ("imu.speed > 0.1", '{"speed": 0.3}'),
        ("imu.stamp > 0", '{"stamp": 7, "speed": 0.3}'),
        ("imu['stamp'] > 0", '{"stamp": 7, "speed": 0.3}'),
    ],
)
def test_when_a_sample_was_published_is_shown_only_if_a_condition_reads_it(when, shown):
    contexts = [a_context("moving", when, tasks={"slam": {"weight": 2}})]
    story = Story(a_policy(streams=[a_stream("imu")], tasks=[a_task("slam")], contexts=contexts), on_node("slam"))
    story.take(Sample("imu", {"stamp": 7, "speed": 0.3}), at=0.0)
    assert sentences(explain(story.planner, START), "slam")[-1] == f"Stream imu: heard 0 s ago; last value {shown}."
