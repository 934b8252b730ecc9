"""Effects that are useless or contradict other contexts: what `validate` says, and that plans agree."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task, on_node


def a_robot(*contexts, slam=(), **spec):
    tasks = [a_task("slam", **dict(slam)), a_task("rest")]
    return a_policy(streams=[a_stream("imu"), a_stream("mic")], tasks=tasks, contexts=[*contexts], **spec)


def reported(policy):
    found = ((one.field, one.allowed) for one in advice(policy))
    return [(field.removeprefix("spec.contexts"), message) for field, message in found if ".tasks.slam." in field]


def turning(name, when, effect, **fields):
    return a_context(name, when, {"slam": effect}, **{"exitAfter": "1ms", **fields})


def at_both(policy, **sample):
    """The last plan of a story in which both contexts begin."""
    story = Story(policy, on_node("slam", "rest", cores=4))
    story.sample("imu", at=1, **{"x": 5.0, **sample})
    story.wait(5)
    return story.last


HOT = turning("hot", "imu.x > 1", {"max": "500m"})


@pytest.mark.parametrize(
    ("needs", "message"),
    [
        ({"cores": 1}, "needs 1 cores, but max allows 500m, while hot holds"),
        ({"cores": 1, "enforce": "Suspend"}, "needs 1 cores, but max allows 500m: slam is suspended while hot holds"),
        ({"deadline": "40ms"}, "with max 500m it may stall for 0.05 s, longer than its deadline, while hot holds"),
    ],
)
def test_a_max_below_what_the_task_needs(needs, message):
    policy = a_robot(HOT, slam={"needs": needs})
    assert reported(policy) == [("[0].tasks.slam.max", message)]
    assert at_both(policy).shortfalls
    assert at_both(policy).tasks["slam"].suspended is ("enforce" in needs)
    assert reported(a_robot(HOT, slam={"needs": {"cores": "500m", "deadline": "50ms"}})) == []


def test_a_need_that_the_tasks_own_max_breaks_is_reported_once():
    policy = a_robot(HOT, slam={"max": "900m", "needs": {"cores": 1}})
    assert reported(policy) == []
    assert "never feasible" in next(one.allowed for one in advice(policy) if one.field == "spec.tasks[0].needs.cores")


FAST = turning("fast", "mic.x > 1", {"min": "1"})


CROSSING = [
    ([FAST, HOT], "min", "is above the max 500m of hot, which may hold beside fast: hot comes later", 500),
    ([HOT, FAST], "max", "is below the min 1 of fast, which may hold beside hot: fast comes later", 1000),
]


@pytest.mark.parametrize(("contexts", "field", "message", "share"), CROSSING)
def test_bounds_that_no_share_meets(contexts, field, message, share):
    policy = a_robot(*contexts)
    (found,) = reported(policy)
    assert found[0] == f"[0].tasks.slam.{field}"
    assert found[1].startswith(message)
    story = Story(policy, on_node("slam", "rest", cores=4))
    story.sample("mic", at=0.5, x=5.0)
    story.sample("imu", at=1, x=5.0)
    assert story.last.tasks["slam"].share == share


@pytest.mark.parametrize("when", ["imu.x < 1", "mic.x > 1 && !contexts.hot"])
def test_bounds_of_contexts_that_exclude_each_other(when):
    fast = turning("fast", when, {"min": "1"}, exitAfter="0s")
    hot = turning("hot", "imu.x > 1", {"max": "500m"}, exitAfter="0s")
    assert reported(a_robot(hot, fast)) == []


def test_bounds_that_some_share_meets():
    assert reported(a_robot(HOT, turning("fast", "mic.x > 1", {"min": "500m"}))) == []


@pytest.mark.parametrize("never", ["abs(imu.x) < 0", "imu.x > 1 && imu.x < 0"])
def test_a_context_that_never_holds_changes_nothing(never):
    assert reported(a_robot(turning("far", never, {"weight": 3}), turning("moving", "imu.x > 1", {"weight": 1}))) == []


VAIN = [
    ({"weight": 3}, {"weight": 1}, "weight"),
    ({"scale": 3}, {"weight": 1}, "scale"),
    ({"min": "1"}, {"min": "500m"}, "min"),
    ({"max": "1"}, {"max": "500m"}, "max"),
    ({"suspend": True}, {"suspend": False}, "suspend"),
    ({"weight": 0}, {"weight": 2, "suspend": False}, "weight"),
]


@pytest.mark.parametrize(("own", "later", "field"), VAIN)
def test_an_effect_always_overridden_by_a_later_context_is_reported(own, later, field):
    first, second = turning("far", "imu.x > 3", own), turning("moving", "imu.x > 1", later)
    policy = a_robot(first, second)
    message = f"{field} has no effect: moving, which comes later, holds whenever far does"
    assert (f"[0].tasks.slam.{field}", message) in reported(policy)
    assert at_both(policy).contexts == ("far", "moving")
    assert at_both(policy).tasks["slam"].share == at_both(a_robot(second)).tasks["slam"].share


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"when": "imu.x > 0"}, {}),
        ({"until": "imu.x < 0"}, {}),
        ({"exitAfter": "1s"}, {}),
        ({}, {"enterAfter": "1s"}),
        ({}, {"until": "mic.x > 1"}),
        ({"when": "imu.x > 3 && mic.x > 1"}, {"when": "imu.x > 1 && mic.x > 2"}),
    ],
)
def test_an_effect_that_may_outlast_the_override_is_not_reported(first, second):
    contexts = [
        turning(**{"name": "far", "when": "imu.x > 3", "effect": {"weight": 3}, **first}),
        turning(**{"name": "moving", "when": "imu.x > 1", "effect": {"weight": 1}, **second}),
    ]
    assert reported(a_robot(*contexts)) == []


def test_a_forced_context_may_hold_without_the_other():
    contexts = [turning("far", "imu.x > 3", {"weight": 3}), turning("moving", "imu.x > 1", {"weight": 1})]
    assert reported(a_robot(*contexts, force={"context": "far", "until": "2100-01-01T00:00:00Z"})) == []
    assert reported(a_robot(*contexts, force={"context": "moving", "until": "2100-01-01T00:00:00Z"})) != []


@pytest.mark.parametrize(("far", "vain"), [({"exitAfter": "0s"}, True), ({}, False)])
def test_a_context_holds_beside_one_that_reads_it(far, vain):
    reader = turning("far", "contexts.moving && mic.x > 1", {"weight": 3}, **far)
    policy = a_robot(reader, turning("moving", "imu.x > 1", {"weight": 1}, until="imu.x < 0"))
    assert bool(reported(policy)) is vain


WEIGHT, STOP = {"weight": 9}, {"suspend": True}


def of_parts(tasks, effects, *later):
    own = [a_task("rest"), a_task("pump"), a_task("slam", requires=[{"task": "pump"}]), *tasks]
    clean = a_context("clean", "imu.x > 1", effects, exitAfter="1ms")
    return a_policy(streams=[a_stream("imu"), a_stream("mic")], tasks=own, contexts=[clean, *later])


def vain(policy):
    return [one.allowed for one in advice(policy) if "can't run without" in one.allowed]


ARM = [a_task("grip"), a_task("lift"), {"name": "arm", "subtasks": ["grip", "lift"]}]
EITHER = [*ARM[:2], {**ARM[2], "satisfiedBy": "Any"}]
STOPPED = [
    ([], "slam", ["pump"], "slam", "pump"),
    (ARM, "arm", ["grip"], "arm", "grip"),
    (ARM, "lift", ["grip"], "lift", "grip"),
    (ARM, "grip", ["arm"], "grip", "arm"),
    (EITHER, "arm", ["grip", "lift"], "arm", "grip and lift"),
]


@pytest.mark.parametrize(("tasks", "weighted", "stopped", "task", "causes"), STOPPED)
def test_a_weight_for_a_task_that_the_same_context_stops(tasks, weighted, stopped, task, causes):
    policy = of_parts(tasks, {weighted: WEIGHT, **dict.fromkeys(stopped, STOP)})
    message = f"weight has no effect: {task} can't run without {causes}, which clean suspends"
    assert vain(policy) == [message]
    assert at_both(policy).tasks[weighted].suspended


@pytest.mark.parametrize(
    ("tasks", "effects", "later"),
    [
        (EITHER, {"arm": WEIGHT, "grip": STOP}, []),
        ([{**ARM[0], "protected": True}, *ARM[1:]], {"grip": WEIGHT, "arm": STOP}, []),
        ([], {"slam": WEIGHT, "pump": STOP}, [a_context("late", "mic.x > 1", {"pump": {"suspend": False}})]),
        ([], {"rest": WEIGHT, "pump": STOP}, []),
    ],
)
def test_a_weight_with_effect_is_not_reported(tasks, effects, later):
    assert vain(of_parts(tasks, effects, *later)) == []


@pytest.mark.parametrize(
    ("night", "vain"),
    [
        ({"when": "imu.lux <= 100"}, True),
        ({"when": "!contexts.day"}, True),
        ({"when": "imu.lux <= 200"}, False),
        ({"when": "mic.x > 1"}, False),
        ({}, False),
    ],
)
def test_lifting_a_suspension_that_never_coincides_is_reported(night, vain):
    day = a_context("day", "imu.lux > 100", {"slam": STOP})
    policy = a_robot(day, a_context("night", tasks={"slam": {"suspend": False}}, **night))
    message = "suspend: false has no effect: no context before night suspends slam beside it"
    assert reported(policy) == [("[1].tasks.slam.suspend", message)] * vain


@pytest.mark.parametrize(
    ("slam", "later", "vain"),
    [
        ({}, {}, True),
        ({"idle": 0.1}, {}, False),
        ({"activity": [{"when": "imu.x < 1", "hold": "1s"}]}, {}, False),
        ({"activity": [{"when": "imu.x > 0"}]}, {}, False),
        ({}, {"weight": 2}, False),
    ],
)
def test_a_scale_of_a_score_that_is_0(slam, later, vain):
    docked = a_context("docked", "imu.x > 1", {"slam": {"scale": 3}})
    other = turning("other", "mic.x > 1", later or {"max": "1"})
    policy = a_robot(docked, other, slam={"activity": [{"when": "imu.x < 1"}], **slam})
    message = "scale has no effect: slam scores 0 while docked holds"
    assert reported(policy) == [("[0].tasks.slam.scale", message)] * vain
    assert not (vain and at_both(policy).tasks["slam"].weight)
