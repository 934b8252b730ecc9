"""Settings without effect: what `validate` says, and what plans show."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task

IMU = a_stream("imu")
STALE = a_stream("imu", staleAfter="1s")


def a_robot(stream=IMU, activity=(), **spec):
    slam = a_task("slam", activity=[dict(activity)]) if activity else a_task("slam")
    asked = a_task("asked", requires=[{"when": "imu.x > 1"}])
    return a_policy(streams=[stream], tasks=[slam, asked, a_task("rest")], **spec)


def reported(policy):
    return [(one.field, one.allowed) for one in advice(policy)]


def scores(policy):
    story = Story(policy)
    for at in (1, 2):
        story.sample("imu", at=at, x=1.0)
    story.wait(1000)
    return [plan.tasks["slam"].score for plan in story.plans]


FOR_EVER = "once imu is heard it counts for ever: hold, when, until or staleAfter would end it"


@pytest.mark.parametrize("more", [{}, {"when": "true"}, {"decay": "2s"}])
def test_an_activity_that_never_ends_is_reported(more):
    policy = a_robot(activity={"stream": "imu", **more})
    assert reported(policy) == [("spec.tasks[0].activity[0].stream", FOR_EVER)]
    assert scores(policy)[-1] == 1


@pytest.mark.parametrize(
    ("stream", "activity"),
    [
        (IMU, {"hold": "1s"}),
        (IMU, {"until": "imu.x < 2"}),
        (IMU, {"when": "imu.x > 3"}),
        (IMU, {"scoreFrom": "imu.x - 1.0"}),
        (STALE, {}),
    ],
)
def test_an_activity_that_may_end_is_not_reported(stream, activity):
    policy = a_robot(stream, {"stream": "imu", **activity})
    assert reported(policy) == []
    assert scores(policy)[-1] == 0


@pytest.mark.parametrize(("idle", "score"), [(1, {}), (1, {"score": 0.5}), (2, {"score": 2.0})])
def test_an_activity_that_scores_no_more_than_idle_is_reported(idle, score):
    activity = {"stream": "imu", "hold": "1s", **score}
    policy = a_policy(streams=[IMU], tasks=[a_task("slam", idle=idle, activity=[activity]), a_task("rest")])
    never = f"never counts: by its idle slam scores {idle} anyway"
    assert reported(policy) == [("spec.tasks[0].activity[0].score", never)]
    assert set(scores(policy)) == {idle}


@pytest.mark.parametrize("score", [{"score": 1.5}, {"scoreFrom": "imu.x"}])
def test_an_activity_that_may_score_more_than_idle_is_not_reported(score):
    activity = {"stream": "imu", "hold": "1s", **score}
    policy = a_policy(streams=[IMU], tasks=[a_task("slam", idle=1, activity=[activity]), a_task("rest")])
    assert reported(policy) == []


def test_a_token_of_liveliness_may_end_it():
    assert reported(a_robot({**IMU, "liveliness": "robot/imu"}, {"stream": "imu"})) == []


@pytest.mark.parametrize("more", [{"hold": "1s"}, {"decay": "1s"}])
def test_an_activity_that_reads_nothing_has_no_end(more):
    policy = a_robot(activity={"score": 2, **more})
    ((field, message),) = reported(policy)
    assert field == f"spec.tasks[0].activity[0].{next(iter(more))}"
    assert message.endswith("has no effect: an activity that reads no stream is always in force")
    assert scores(policy)[-1] == 2
    assert reported(a_robot(activity={"score": 2})) == []


def test_an_activity_that_never_begins_is_reported():
    policy = a_robot(activity={"stream": "imu", "when": "false"})
    assert reported(policy) == [("spec.tasks[0].activity[0].when", "never holds, so the activity never counts")]
    assert set(scores(policy)) == {0}


REST = {"rest": {"weight": 2}}


def test_delays_of_a_context_without_condition():
    lost = a_context("lost", tasks=REST, enterAfter="5s", exitAfter="3s")
    policy = a_robot(STALE, contexts=[lost], fallback="lost")
    has_none = "has no effect without when: silence and force begin and end lost at once"
    expected = [(f"spec.contexts[0].{name}", f"{name} {has_none}") for name in ("enterAfter", "exitAfter")]
    assert reported(policy) == expected
    story = Story(policy)
    story.sample("imu", at=1, x=1.0)
    story.sample("imu", at=9, x=1.0)
    story.wait(9.5)
    assert story.contexts_over_time() == [(0.0, ()), (2.0, ("lost",)), (9.0, ())]
    conditional = a_context("lost", "imu.x > 1", REST, enterAfter="5s", exitAfter="3s")
    assert reported(a_robot(STALE, contexts=[conditional], fallback="lost")) == []


@pytest.mark.parametrize(
    ("field", "stream", "spec"),
    [
        ("spec.streams[0].key", {"key": "robot/+/imu"}, {}),
        ("spec.streams[0].liveliness", {"liveliness": "robot/+"}, {}),
        ("spec.shadow.health", {}, {"shadow": {"of": "other", "health": "+/*/health"}}),
    ],
)
def test_the_mqtt_wildcard_is_reported(field, stream, spec):
    ((where, message),) = reported(a_robot({**IMU, **stream}, **spec))
    assert where == field
    assert message.startswith("+ is MQTT's wildcard")


@pytest.mark.parametrize("name", ["source", "sources"])
def test_fields_of_samples_that_sources_hide(name):
    stream = {**IMU, "key": "robot/*/imu", "example": {"x": 1.0, name: 3}}
    ((field, message),) = reported(a_robot({**stream, "sources": 2}))
    assert field == "spec.streams[0].sources"
    assert message == f"its samples' own field {name} can't be read: sources gives them another one of this name"
    assert reported(a_robot(stream)) == []
    apart = a_context("left", f"size(imu.{name}) > 0 && imu.x > 1", REST, exitAfter="1s")
    assert reported(a_robot({**stream, "example": {"x": 1.0}, "sources": 2}, contexts=[apart])) == []
