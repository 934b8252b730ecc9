"""What people read, of what a planner knows; tests/commands/test_explain.py has whole runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import sentences
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task, on_node, together


def explained(task, placement):
    tasks = [a_task("slam", priority=3), a_task("speech")]
    policy = a_policy(streams=[a_stream("imu")], tasks=tasks, enforcement={"scheduler": "Realtime"}, reserve="0")
    return sentences(explain(Story(policy, placement).planner, START + 1), task)


def test_what_contexts_change_and_what_protection_rules_out():
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


@pytest.fixture
def two_nodes():
    """One is in realtime, the other can't be."""
    able, unable = on_node("slam", "speech", node="able"), on_node("slam", "speech", cores=20, node="unable")
    return replace(together(able, unable), fair_only=frozenset({"unable"}))


def test_a_node_in_realtime_is_divided_by_eq_2():
    told = explained("slam", on_node("slam", "speech", cores=2))
    assert told[0] == "slam gets 1426m on node robot."
    assert told[-2:] == [
        "Eq. 2 on node robot: 1900m * 3 / 4 = 1425m.",
        "Shares move in steps of 2m, which makes it 1426m.",
    ]


def test_a_deadline_in_realtime_is_that_of_a_thread_on_one_of_the_processors():
    tasks = [a_task("slam", min=2, needs={"cores": 2, "deadline": "60ms"}), a_task("rest", priority=9)]
    story = Story(a_policy(tasks=tasks, enforcement={"scheduler": "Realtime"}), on_node("slam", "rest", cores=4))
    needs = explain(story.planner, START + 1)["tasks"]["slam"]["needs"]
    assert [(need["given"], need["met"]) for need in needs] == [(2000, True), (pytest.approx(0.05), True)]


def test_a_node_that_fell_back_is_divided_by_eq_1(two_nodes):
    told = explained("slam", two_nodes)
    assert told[0] == "slam gets 713m on node able and 15000m on node unable."
    assert [one for one in told if one.startswith("Eq.")] == [
        "Eq. 2 on node able: 950m * 3 / 4 = 712.5m.",
        "Eq. 1 on node unable: 20000m * 3 / 4 = 15000m.",
    ]
