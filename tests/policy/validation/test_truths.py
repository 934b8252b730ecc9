"""Conditions that never hold, or always: by themselves, by what can be at all, and by the contexts that they read."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task

WINDOWS = [{"name": "often", "op": "count", "over": "5s"}, {"name": "perSecond", "op": "rate", "over": "5s"}]
IMU = a_stream("imu", features=WINDOWS)
SLAM = {"slam": {"weight": 2}}
ALWAYS = "always holds, whatever imu sends"
NEVER = ("never holds, whatever imu sends", "never holds: it contradicts itself")


def a_robot(when, *contexts, stream=IMU, **spec):
    own = a_context("asked", when, SLAM, enterAfter="1ms")
    spec = {"tasks": [a_task("slam"), a_task("rest")], **spec}
    return a_policy(streams=[stream, a_stream("mic")], contexts=[*contexts, own], **spec)


def reported(policy):
    return [one.allowed for one in advice(policy) if one.field == f"spec.contexts[{len(policy.contexts) - 1}].when"]


NOTHING_IS_SO = [
    "abs(imu.x) < 0",
    "0 > norm(imu.v)",
    "sqrt(imu.x) == -1",
    "size(imu.l) < 0",
    "imu.l.size() == 1.5",
    "size(imu.l) > 2 && size(imu.l) < 3",
    "uint(imu.x) < 0",
    "age(imu) < 0.0",
    "timestamp(imu.t).getMonth() == 12",
    "timestamp(imu.t).getDayOfWeek() > 6",
    "timestamp(imu.t).getHours() >= 24",
    "imu.often < 0",
    "imu.often > 10000",
    "imu.perSecond > 2000",
    "imu.often > 1 && imu.often < 2",
    "imu.at < '06:00' && imu.at > '22:00'",
    "imu.at < ''",
    "imu.job == 0 && imu.job == 'ready'",
]


@pytest.mark.parametrize("when", NOTHING_IS_SO)
def test_impossible_conditions_are_reported(when):
    assert [one in NEVER for one in reported(a_robot(when))] == [True]
    assert reported(a_robot(f"!({when})")) == [ALWAYS]


@pytest.mark.parametrize(
    "when",
    [
        "!has(imu.x) && imu.x > 9",
        "!has(imu.l) && size(imu.l) > 9",
        "!has(imu.v) && imu.v.x > 9",
        "!has(imu.v) && has(imu.v.x)",
        "!heard(imu) && imu.x > 9",
    ],
)
def test_conditions_on_what_they_ask_to_be_missing_are_reported(when):
    assert [one in NEVER for one in reported(a_robot(when))] == [True]
    story = Story(a_robot(when))
    story.sample("imu", at=1, y=1.0)
    story.sample("imu", at=2, x=10.0, l=[0] * 10, v={"x": 10.0})
    story.wait(1)
    assert not any(active for _, active in story.contexts_over_time())


@pytest.mark.parametrize(
    "when",
    [
        "has(imu.x) || imu.x > 9",
        "has(imu.x) || imu.x < 5",
        "!has(imu.x) || imu.x > 9",
        "!has(imu.x) && imu.y > 9",
        "!has(imu.v.x) && size(imu.v) == 0",
        "!has(imu.x) && (has(imu.x) ? imu.x : 10.0) > 9",
        "!has(imu.x) && has(imu.x) == false",
        "!(!has(imu.x) && imu.x > 9)",
        "heard(imu) || imu.x < 5",
        "!heard(imu) && age(imu) > 9",
    ],
)
def test_conditions_on_what_may_be_missing_are_not_reported(when):
    assert reported(a_robot(when)) == []


LIFTS = a_stream("lift", key="lift/*", sources=2, staleAfter="2s")


@pytest.mark.parametrize(
    "when",
    [
        "size(lift.sources) >= 3",
        "3 <= lift.sources.size()",
        "lift.sources.filter(l, l.moving).size() > 2",
        "size(lift.sources.map(l, l.load)) == 3",
    ],
)
def test_no_more_sources_than_are_kept_apart_are_there(when):
    assert reported(a_robot(when, stream=LIFTS)) == ["never holds, whatever lift sends"]


@pytest.mark.parametrize(
    "when",
    [
        "size(lift.sources) >= 2",
        "lift.sources.filter(l, l.moving).size() < 1",
        "size(lift.sources.map(l, [1, 2, 3])[0]) > 2",
    ],
)
def test_as_many_sources_as_are_kept_apart_may_be_there(when):
    assert reported(a_robot(when, stream=LIFTS)) == []


@pytest.mark.parametrize(
    "when",
    [
        "abs(imu.x) <= 0",
        "size(imu.l) < 1",
        "size(imu.l) > 2 && size(imu.l) < 4",
        "timestamp(imu.t).getMonth() == 11",
        "duration(imu.t).getHours() > 24",
        "imu.often < 1",
        "imu.often > 9999",
        "imu.perSecond > 0.1 && imu.perSecond < 0.2",
        "imu.x < 0",
        "imu.x != imu.x",
        "heard(imu)",
        "imu.x > 1 || heard(imu)",
        "imu.at < '06:00'",
        "imu.at >= '06:00'",
        "imu.at > '06:00' && imu.at < '22:00'",
        "imu.at >= '22:00' || imu.at < '06:00'",
        "imu.job != 'none' && imu.job != 0",
        "imu.job != 0 && imu.job == 'ready'",
        "imu.job == 0 || imu.job == 'ready'",
    ],
)
def test_possible_conditions_are_not_reported(when):
    assert reported(a_robot(when)) == []


@pytest.mark.parametrize("when", ["imu.x > 1 || imu.x < 5", "imu.m != 'a' || imu.m != 'b'", "age(imu) >= 0.0"])
def test_conditions_that_always_hold_are_reported(when):
    assert reported(a_robot(when)) == [ALWAYS]


def test_a_window_holds_no_more_samples_than_may_come():
    slow = {**IMU, "sampleEvery": "1s"}
    assert reported(a_robot("imu.often > 6", stream=slow)) == [NEVER[0]]
    story = Story(a_robot("imu.often > 4", stream=slow))
    for number in range(100):
        story.sample("imu", at=number / 10, x=1.0)
    story.wait(10)
    assert story.contexts_over_time()[-1][1] == ("asked",)


MOVING, DOCKED = a_context("moving", "imu.x > 1", SLAM), a_context("docked", "imu.x < 1", SLAM)
LOST = a_context("lost", tasks=SLAM)
STALE = {**IMU, "staleAfter": "1s"}
EXCLUDED = [
    ("contexts.moving && contexts.docked", [MOVING, DOCKED], {}),
    ("contexts.moving && imu.x < 1", [MOVING], {}),
    ("!contexts.moving && imu.x > 2", [MOVING], {}),
    ("contexts.further && imu.x < 1", [MOVING, a_context("further", "contexts.moving", SLAM)], {}),
    ("contexts.lost", [LOST], {}),
    ("contexts.lost && imu.x > 1", [LOST], {"fallback": "lost", "stream": STALE}),
    ("contexts.ended && imu.x > 2", [a_context("ended", "imu.x > 1", SLAM, until="imu.x > 1.5")], {}),
]
POSSIBLE = [
    ("contexts.moving && contexts.docked", [{**MOVING, "exitAfter": "1s"}, DOCKED], {}),
    ("contexts.moving && imu.x < 1", [{**MOVING, "exitAfter": "1s"}], {}),
    ("contexts.moving && imu.x < 1", [{**MOVING, "until": "imu.x < 0"}], {}),
    ("!contexts.moving && imu.x > 2", [{**MOVING, "enterAfter": "1s"}], {}),
    ("contexts.lost && age(imu) > 2.0", [LOST], {"fallback": "lost", "stream": STALE}),
    ("contexts.lost && !heard(imu)", [LOST], {"fallback": "lost", "stream": STALE}),
    ("contexts.lost || imu.x > 1", [LOST], {"fallback": "lost", "stream": STALE}),
    ("contexts.moving && mic.x < 1", [MOVING], {}),
    ("contexts.moving && !heard(imu)", [MOVING], {"fallback": "moving", "stream": STALE}),
]


def contexts_seen(policy):
    story = Story(policy)
    for at, x in [(1, 0.0), (2, 3.0), (2.5, 0.0), (3, 1.2), (4, 3.0), (4.2, 0.5), (9, 3.0), (10, 1.0), (11, -1.0)]:
        story.sample("mic", at=at, x=0.0)
        story.sample("imu", at=at, x=x)
    story.wait(20)
    return {name for _, active in story.contexts_over_time() for name in active}


@pytest.mark.parametrize(("when", "contexts", "spec"), EXCLUDED)
def test_conditions_excluded_by_their_contexts_are_reported(when, contexts, spec):
    policy = a_robot(when, *contexts, **spec)
    assert [one.startswith("never holds, as ") for one in reported(policy)] == [True]
    assert "asked" not in contexts_seen(policy)


@pytest.mark.parametrize(("when", "contexts", "spec"), POSSIBLE)
def test_conditions_allowed_by_their_contexts_are_not_reported(when, contexts, spec):
    policy = a_robot(when, *contexts, **spec)
    assert reported(policy) == []
    assert "asked" in contexts_seen(policy)


def test_the_excluding_contexts_are_named():
    policy = a_robot("contexts.moving && contexts.docked", MOVING, DOCKED)
    assert reported(policy) == ["never holds, as docked and moving are defined"]


def test_activities_and_pre_conditions_read_contexts_too():
    waiting = a_task("slam", requires=[{"when": "contexts.moving && imu.x < 1"}])
    active = a_task("map", activity=[{"when": "contexts.moving && imu.x < 1"}])
    found = advice(a_robot("mic.x > 1", MOVING, tasks=[waiting, active, a_task("rest")]))
    never = [one.field for one in found if one.allowed == "never holds, as moving is defined"]
    assert never == ["spec.tasks[0].requires[0].when", "spec.tasks[1].activity[0].when"]
