"""An edit keeps what it did not change, timers included; what it did change restarts."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.planning.conditions.absence import UNHEARD
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from tests.planning.builders import START, Story, a_body, a_context, a_policy, a_stream, a_task
from tests.planning.quiet import Quiet

SPEC: dict[str, Any] = {
    "streams": [
        a_stream("imu", staleAfter="20s", features=[{"name": "bumps", "op": "count", "over": "30s"}]),
        a_stream("mic", debounce="10s"),
    ],
    "tasks": [
        a_task("slam", activity=[{"when": "imu.speed > 0", "hold": "15s", "score": 5, "decay": "10s"}], idle=1),
        a_task("speech", requires=[{"when": "imu.speed > 0", "hold": "12s"}]),
    ],
    "contexts": [
        a_context("moving", "imu.speed > 0", {"slam": {"scale": 2}}, exitAfter="8s"),
        a_context("soon", "imu.speed == 0", enterAfter="9s"),
        a_context("shaken", "imu.bumps > 1"),
        a_context("loud", "mic.level > 0"),
        a_context("late", "age(imu) > 10"),
    ],
}


def edited(**changes):
    """A story in which the policy is edited 3 s after its last sample, and the same without the edit."""
    stories = []
    for edit in (changes, None):
        story = Story(a_policy(**SPEC))
        for at, speed in ((1, 1.0), (2, 1.0), (5, 0.0)):
            story.sample("imu", at=at, speed=speed)
        story.sample("mic", at=6, level=1.0)
        if edit is not None:
            story.wait(8)
            placement, before = story.planner.placement, story.planner
            story.planner = Planner(a_policy(**{**SPEC, **edit}), Quiet(), {})
            story.plans = story.planner.start(START + 8, before)
            story.place(placement, at=8)
        stories.append(story)
    return stories


def course(story):
    """Contexts, scores and pre-conditions at each later instant at which something happens."""
    seen = {}
    while (due := story.next_decision()) is not None:
        story.wait(due - START)
        contexts = [context.spec.name for context in story.planner.active_contexts()]
        seen[round(due - START, 6)] = (contexts, story.planner.scores(), dict(story.planner._scores.unmet))
    return seen


UNRELATED = [
    pytest.param({"reserve": "10m"}, id="reserve"),
    pytest.param({"mode": "DryRun"}, id="mode"),
    pytest.param({"streams": [*SPEC["streams"], a_stream("lidar")]}, id="another stream"),
    pytest.param({"contexts": [*SPEC["contexts"], a_context("more", "mic.level > 9")]}, id="another context"),
    pytest.param({"tasks": [*SPEC["tasks"], a_task("rest")]}, id="another task"),
    pytest.param({"contexts": SPEC["contexts"][::-1]}, id="order"),
]


@pytest.mark.parametrize("changes", UNRELATED)
def test_an_unrelated_edit_changes_nothing(changes):
    story, unedited = edited(**changes)
    unedited.wait(8)
    assert story.planner.active_contexts() != []
    expected = course(unedited)
    assert len(expected) > 10
    seen = course(story)
    for _, scores, _ in seen.values():
        scores.pop("rest", None)
    assert {at: (set(contexts), *rest) for at, (contexts, *rest) in seen.items()} == {
        at: (set(contexts), *rest) for at, (contexts, *rest) in expected.items()
    }


def test_the_first_plan_after_an_edit_continues_the_last():
    story, _ = edited(reserve="10m")
    assert story.last.contexts == ("moving", "shaken")
    assert story.last.tasks["slam"].weight == 10.0
    assert not story.last.tasks["speech"].suspended


def test_an_edited_stream_and_its_readers_start_over():
    streams = [a_stream("imu", key="robot/other", staleAfter="20s"), SPEC["streams"][1]]
    contexts = [context for context in SPEC["contexts"] if context["name"] != "shaken"]
    story, _ = edited(streams=streams, contexts=contexts)
    assert story.planner.streams["imu"].value is None
    assert [context.spec.name for context in story.planner.active_contexts()] == ["late"], "its age is infinite"
    assert story.planner.scores()["slam"] == 1.0
    story.wait(16)
    assert [context.spec.name for context in story.planner.active_contexts()] == ["loud", "late"]


def test_an_edited_activity_is_evaluated_again():
    tasks = [a_task("slam", activity=[{"when": "imu.speed >= 0", "score": 7}]), SPEC["tasks"][1]]
    story, _ = edited(tasks=tasks)
    assert story.planner.scores()["slam"] == 7.0


def test_a_task_that_was_edited_elsewhere_keeps_its_events():
    tasks = [{**SPEC["tasks"][0], "priority": 3}, SPEC["tasks"][1]]
    story, _ = edited(tasks=tasks)
    assert story.planner.scores()["slam"] == 5.0
    story.wait(18)
    assert story.planner.scores()["slam"] == 4.5


def test_editing_effects_keeps_a_context_active():
    contexts = [a_context("moving", "imu.speed > 0", {"slam": {"scale": 3}}, exitAfter="8s"), *SPEC["contexts"][1:]]
    story, _ = edited(contexts=contexts)
    assert story.last.tasks["slam"].weight == 15.0
    story.wait(13)
    assert "moving" not in story.last.contexts


def test_editing_a_delay_keeps_the_context_and_restarts_the_delay():
    contexts = [a_context("moving", "imu.speed > 0", exitAfter="30s"), *SPEC["contexts"][1:]]
    story, _ = edited(contexts=contexts)
    story.wait(60)
    ends = [plan.time - START for plan in story.plans if "moving" not in plan.contexts]
    assert ends[0] == 38


def test_silence_and_the_fallback_last_through_an_edit():
    spec = {**SPEC, "contexts": [*SPEC["contexts"], a_context("blind")], "fallback": "blind"}
    story = Story(a_policy(**spec))
    story.wait(30)
    assert story.last.contexts == ("late", "blind")
    planner = Planner(a_policy(**spec, reserve="10m"), Quiet(), {})
    plans = planner.start(START + 40, story.planner)
    assert plans[-1].contexts == ("late", "blind")
    assert planner.next_due() == START + UNHEARD


def test_new_expressions_see_the_last_sample_at_once():
    contexts = [*SPEC["contexts"], a_context("slow", "imu.speed < 1 && heard(imu)")]
    story, _ = edited(contexts=contexts)
    assert "slow" in story.last.contexts


def test_a_version_that_never_started_leaves_no_state():
    policy = parsing.parse(a_body(**SPEC))
    planner = Planner(policy, Quiet(), {})
    planner.start(START, Planner(policy, Quiet(), {}))
    assert planner.next_due() == START + 20
