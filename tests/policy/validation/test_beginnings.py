"""Holds that nothing begins: what `validate` says, and that the planner indeed never begins them."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task

OFTEN = {"name": "often", "op": "count", "over": "2s"}
PER_SECOND = {"name": "perSecond", "op": "rate", "over": "2s"}
STREAMS = [a_stream("imu", staleAfter="1s"), a_stream("mic", features=[OFTEN, PER_SECOND])]
LOST = a_context("lost", tasks={"rest": {"weight": 2}})
BLIND = a_context("blind", "age(imu) > 2", {"rest": {"weight": 2}}, exitAfter="1ms")
MOVING = a_context("moving", "imu.x > 1", {"rest": {"weight": 2}}, exitAfter="1ms")
EITHER = a_context("either", "contexts.lost || contexts.blind", {"rest": {"weight": 2}})
STEERED = a_context("steered", "age(imu) > 2", {"rest": {"weight": 2}}, until="mic.x > 1", exitAfter="1ms")
CALM = a_context("calm", "mic.often < 1", {"rest": {"weight": 2}}, exitAfter="1ms")
CONTEXTS = [LOST, BLIND, MOVING, EITHER, STEERED, CALM]

NEVER = [
    {"when": "contexts.lost"},
    {"when": "contexts.blind"},
    {"when": "contexts.either"},
    {"when": "contexts.lost && contexts.blind"},
    {"when": "age(imu) > 2"},
    {"when": "!heard(imu)"},
    {"when": "age(imu) >= 2", "stream": "imu"},
    {"when": "mic.often < 1"},
    {"when": "mic.perSecond < 0.5"},
    {"when": "mic.often < 1 && mic.x > 0"},
    {"when": "contexts.calm"},
]
"""By silence, time, a window that empties or force alone."""
SOMETIMES = [
    {"when": "contexts.moving"},
    {"when": "!contexts.lost"},
    {"when": "contexts.lost || contexts.moving"},
    {"when": "contexts.steered"},
    {"when": "contexts.blind && mic.x > 0"},
    {"when": "age(imu) > 2 && heard(mic)"},
    {"when": "age(imu) < 2"},
    {"when": "heard(imu)"},
    {"when": "mic.often < 2"},
    {"when": "mic.perSecond < 0.6"},
    {"when": "mic.often < 1 && imu.x > 0"},
    {"when": "!contexts.calm"},
    {"when": "true"},
]


def a_robot(**activity):
    tasks = [a_task("slam", activity=[{"hold": "1s", **activity}]), a_task("rest")]
    return a_policy(streams=STREAMS, tasks=tasks, contexts=CONTEXTS, fallback="lost")


def reported(policy):
    return [finding for finding in advice(policy) if "with hold only a sample begins it" in finding.allowed]


@pytest.mark.parametrize("activity", NEVER, ids=str)
def test_a_hold_that_never_begins_is_reported(activity):
    (finding,) = reported(a_robot(**activity))
    assert (finding.field, finding.value) == ("spec.tasks[0].activity[0].hold", 1.0)


@pytest.mark.parametrize("activity", SOMETIMES, ids=str)
def test_a_hold_that_a_sample_may_begin_is_not_reported(activity):
    assert reported(a_robot(**activity)) == []


@pytest.mark.parametrize("activity", NEVER, ids=str)
def test_reported_activities_never_score(activity):
    assert highest_score(activity) == 0.0


@pytest.mark.parametrize("activity", [one for one in SOMETIMES if one["when"] != "true"], ids=str)
def test_unreported_activities_may_score(activity):
    assert highest_score(activity) == 1.0


def highest_score(activity):
    """Of a story with samples, silence, ages and contexts that turn by each of them."""
    story = Story(a_robot(**activity))
    for at, stream, value in [
        (0.5, "mic", 2.0),
        *[(1 + 0.3 * number, "imu", 2.0 * (number % 2)) for number in range(9)],
        (6.5, "mic", 2.0),
        (6.8, "mic", 0.5),
        (7, "imu", 2.0),
        (12, "imu", 2.0),
        (20, "mic", 2.0),
        (21, "mic", 0.0),
    ]:
        story.sample(stream, at=at, x=value)
    story.wait(30)
    return max(plan.tasks["slam"].score for plan in story.plans)


def test_without_hold_such_a_context_begins_it():
    assert reported(a_robot(when="contexts.lost", hold=None)) == []
    assert highest_score({"when": "contexts.lost", "hold": None}) == 1.0


def test_the_hold_of_a_pre_condition_is_reported_too():
    tasks = [a_task("slam", requires=[{"when": "contexts.lost", "hold": "1s"}]), a_task("rest")]
    policy = a_policy(streams=STREAMS, tasks=tasks, contexts=CONTEXTS, fallback="lost")
    (finding,) = reported(policy)
    assert finding.field == "spec.tasks[0].requires[0].hold"
    assert finding.allowed == "with hold only a sample begins it, and none can: none turns lost so"


def test_force_is_not_an_event():
    tasks = [a_task("slam", activity=[{"when": "contexts.care", "hold": "1s"}]), a_task("rest")]
    force = {"context": "care", "until": "2100-01-01T00:00:00Z"}
    policy = a_policy(streams=STREAMS, tasks=tasks, contexts=[a_context("care", tasks={"rest": {"weight": 2}})])
    assert reported(policy) != []
    forced = a_policy(streams=STREAMS, tasks=tasks, contexts=[a_context("care")], force=force)
    assert reported(forced) != []
    assert max(plan.tasks["slam"].score for plan in Story(forced).plans) == 0.0


def test_a_hold_is_not_reported_if_the_score_is_0():
    assert reported(a_robot(when="imu.x > 1", scoreFrom="0.0")) == []
