"""Tasks of priority 0: what a plan gives them, and what `validate` says."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_parent, a_policy, a_stream, a_task

STREAMS = [a_stream("imu"), a_stream("mic", producedBy="speech")]
SLAM = a_task("slam", activity=[{"when": "imu.x > 1", "hold": "1s"}], idle=0.5)
NEVER = "a task of priority 0 whose weight no context sets is always suspended"
LONELY = "nothing wakes speech without mic, which speech itself produces"


def a_robot(speech, *contexts, tasks=(SLAM,), **spec):
    spec = {"streams": STREAMS, **spec}
    return a_policy(tasks=[a_task("speech", priority=0, **speech), *tasks], contexts=[*contexts], **spec)


def reported(policy):
    found = [(one.field, one.allowed) for one in advice(policy)]
    return [one for one in found if not one[1].startswith("nothing reads")]


def a_turn(effect, when="imu.x > 1"):
    return a_context("turn", when, {"speech": effect}, exitAfter="1ms")


def highest_weight(policy):
    """Of speech in a story with all that its contexts wait for, but without what it does not send while suspended."""
    story = Story(policy)
    for at, value in enumerate((0.0, 2.0, 0.0)):
        story.sample("imu", at=at, x=value)
        if not story.last.tasks["speech"].suspended:
            story.sample("mic", at=at + 0.5, x=2.0)
    story.wait(10)
    return max(plan.tasks["speech"].weight for plan in story.plans)


@pytest.mark.parametrize("effect", [{"scale": 2}, {"max": "500m"}, {"suspend": True}, {"weight": 0}])
@pytest.mark.parametrize("speech", [{}, {"idle": 1}, {"activity": [{"stream": "imu"}]}])
def test_without_a_weight_priority_0_never_runs(speech, effect):
    policy = a_robot(speech, a_turn(effect))
    assert ("spec.tasks[0].priority", NEVER) in reported(policy)
    assert highest_weight(policy) == 0


def test_a_weight_from_a_context_lets_it_run():
    policy = a_robot({}, a_turn({"weight": 2}))
    assert reported(policy) == []
    assert highest_weight(policy) == 2


def test_a_protected_task_keeps_only_its_min():
    ((field, message),) = reported(a_robot({"protected": True, "min": "200m"}))
    assert field == "spec.tasks[0].priority"
    assert message.endswith("never gets more than its min")


def test_scores_and_scales_without_effect_are_reported():
    policy = a_robot({"idle": 1, "activity": [{"when": "imu.x > 1"}]}, a_turn({"scale": 2}))
    assert [field for field, _ in reported(policy)] == [
        "spec.tasks[0].priority",
        "spec.tasks[0].activity",
        "spec.tasks[0].idle",
        "spec.contexts[0].tasks.speech.scale",
    ]
    scaled = a_context("scaled", "imu.x > 2", {"speech": {"scale": 2}}, exitAfter="1ms")
    assert reported(a_robot({}, a_turn({"weight": 2}), scaled)) == []
    assert reported(a_robot({}, scaled, a_turn({"weight": 2}))) != []


def test_it_is_silent_until_a_context_weights_it():
    policy = a_robot({}, a_turn({"weight": 2}, "mic.x > 1"))
    assert reported(policy) == [("spec.tasks[0].priority", LONELY)]
    assert highest_weight(policy) == 0


@pytest.mark.parametrize(
    ("waiting", "field"),
    [({"requires": [{"when": "mic.x > 1"}]}, "requires[0].when"), ({"activity": [{"stream": "mic"}]}, "idle")],
)
def test_tasks_that_wait_for_its_stream_are_reported(waiting, field):
    message = dict(reported(a_robot({}, tasks=[SLAM, a_task("chat", **waiting)])))[f"spec.tasks[2].{field}"]
    assert message.endswith("without mic, which speech produces")


def test_its_silence_begins_the_fallback():
    streams = [STREAMS[0], {**STREAMS[1], "staleAfter": "1s"}]
    lost = a_context("lost", tasks={"slam": {"weight": 2}})
    policy = a_robot({}, lost, a_turn({"weight": 2}), streams=streams, fallback="lost")
    ((field, message),) = reported(policy)
    assert field == "spec.tasks[0].priority"
    assert message.endswith("begins the fallback lost, from the start")


def test_the_parts_of_a_group_of_priority_0_are_at_rest_with_it():
    group = a_parent("talk", "speech", priority=0)
    chat = a_task("chat", requires=[{"when": "mic.x > 1"}])
    policy = a_policy(streams=STREAMS, tasks=[a_task("speech"), group, SLAM, chat])
    assert dict(reported(policy))["spec.tasks[3].requires[0].when"].endswith("which speech produces")


def test_an_activity_with_score_0_wakes_no_task():
    speech = a_task("speech", activity=[{"when": "imu.x > 1", "score": 0}])
    chat = a_task("chat", requires=[{"when": "mic.x > 1"}])
    policy = a_policy(streams=STREAMS, tasks=[speech, SLAM, chat])
    assert "spec.tasks[2].requires[0].when" in dict(reported(policy))
