"""Loops within a policy: it stops what it then waits for."""

from __future__ import annotations

import pytest

from tests.policy.validation.loops import (
    COMES_AND_GOES,
    COUNTED,
    IMU,
    LATCHED,
    MIC,
    STALE,
    TASKS,
    a_context,
    a_task,
    warned,
)


def test_a_context_that_suspends_what_it_waits_for_holds_forever():
    assert warned() == [f"context quiet suspends speech, which produces mic: {LATCHED}"]


def test_a_stream_that_goes_stale_makes_it_come_and_go():
    (reported,) = warned(streams=[STALE, IMU])
    assert reported.endswith(COMES_AND_GOES)


@pytest.mark.parametrize("streams", [[MIC, IMU], [STALE, IMU]])
def test_until_waits_for_the_stream_too(streams):
    context = a_context(when="imu.x > 1", until="mic.level > 0.3")
    (reported,) = warned(streams=streams, contexts=[context])
    assert reported.endswith(LATCHED)


@pytest.mark.parametrize(
    ("until", "streams", "latches"),
    [
        ("mic.level > 0.3 || imu.x < 1", [MIC, IMU], False),
        ("mic.level > 0.3 || mic.off", [MIC, IMU], True),
        ("mic.level > 0.3 || (mic.off && imu.x < 1)", [MIC, IMU], False),
        ("mic.level > 0.3 || (mic.off && imu.x < 1)", [STALE, IMU], True),
        ("mic.level > 0.3 && imu.x < 1", [MIC, IMU], False),
        ("mic.level > 0.3 && imu.x < 1", [STALE, IMU], True),
        ("mic.level > 0.3 || age(mic) > 5", [MIC, IMU], False),
        ("mic.level > 0.3 || 5 < age(mic)", [MIC, IMU], False),
        ("mic.level > 0.3 || !(age(mic) < 5)", [MIC, IMU], False),
        ("mic.level > 0.3 || age(mic) < 5", [MIC, IMU], True),
        ("mic.level > 0.3 || age(mic) < 5", [STALE, IMU], True),
        ("mic.level > 0.3 && age(mic) > 5", [MIC, IMU], False),
        ("mic.level > 0.3 && age(mic) > 5", [STALE, IMU], True),
        ("mic.level > 0.3 || !heard(mic)", [STALE, IMU], False),
        ("mic.level > 0.3 || !heard(mic)", [MIC, IMU], True),
        ("mic.level > 0.3 || !has(mic.level)", [STALE, IMU], False),
        ("!has(mic.level)", [MIC, IMU], True),
        ("heard(mic)", [STALE, IMU], True),
        ("mic.often < 1", [COUNTED, IMU], False),
    ],
)
def test_each_alternative_of_until_may_end_it(until, streams, latches):
    reported = warned(streams=streams, contexts=[a_context(when="imu.x > 1", until=until)])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches


def test_until_is_followed_through_what_begins_a_context():
    docked = a_context("docked", "imu.docked", suspends="", until="mic.level > 0.3")
    until = {"when": "imu.x > 1", "until": "contexts.docked"}
    assert warned(contexts=[docked, a_context(**until)]) == []
    docked = a_context("docked", "mic.level > 0.3", suspends="")
    (reported,) = warned(contexts=[docked, a_context(**until)])
    assert reported.endswith(LATCHED)


def test_a_context_that_silence_ends_is_not_a_latch():
    calm = a_context("calm", suspends="")
    context = a_context(when="imu.x > 1", until="!contexts.calm")
    assert warned(streams=[STALE, IMU], contexts=[calm, context]) == []
    (reported,) = warned(contexts=[calm, context])
    assert reported.endswith(LATCHED)


@pytest.mark.parametrize(
    ("when", "ending"),
    [
        ("heard(mic)", COMES_AND_GOES),
        ("!heard(mic)", LATCHED),
        ("!has(mic.level)", LATCHED),
        ("!(mic.level > 0.1)", COMES_AND_GOES),
        ("age(mic) > 5 && mic.level < 1", COMES_AND_GOES),
    ],
)
def test_silence_ends_what_needs_a_value(when, ending):
    (reported,) = warned(streams=[STALE, IMU], contexts=[a_context(when=when)])
    assert reported.endswith(ending)


def test_it_is_followed_through_the_contexts_that_are_read():
    calm = a_context("calm", suspends="")
    (reported,) = warned(contexts=[calm, a_context(when="contexts.calm")])
    assert reported.endswith(LATCHED)


@pytest.mark.parametrize("parent", [{}, {"satisfiedBy": "Any"}])
def test_it_is_followed_through_the_task_graph(parent):
    group = {"name": "talk", "subtasks": ["speech"], **parent}
    (reported,) = warned(tasks=[*TASKS, group], contexts=[a_context(suspends="talk")])
    assert reported.endswith(LATCHED)
    tasks = [a_task("speech", requires=[{"task": "slam"}]), a_task("slam")]
    (reported,) = warned(tasks=tasks, contexts=[a_context(suspends="slam")])
    assert reported.endswith(LATCHED)


@pytest.mark.parametrize(
    "context",
    [
        a_context(when="mic.level < 0.1 && imu.x > 1"),
        a_context(when="mic.level < 0.1", until="imu.x > 1"),
        a_context(suspends="slam"),
        a_context(suspends=""),
    ],
)
def test_a_context_ended_otherwise_is_not_a_latch(context):
    assert warned(contexts=[context], streams=[COUNTED, IMU]) == []


AVERAGE = {**MIC, "features": [{"name": "mean", "op": "mean", "of": "mic.level", "over": "5s"}]}


@pytest.mark.parametrize(
    ("stream", "when", "ending"),
    [
        (AVERAGE, "mic.mean > 1", COMES_AND_GOES),
        (AVERAGE, "!(mic.mean > 1)", COMES_AND_GOES),
        (COUNTED, "mic.often > 2.0", COMES_AND_GOES),
        (COUNTED, "mic.often < 2.0", LATCHED),
        (MIC, "age(mic) < 3.0", COMES_AND_GOES),
        (MIC, "mic.level > 1 && age(mic) < 3.0", COMES_AND_GOES),
    ],
)
def test_a_window_that_empties_and_an_age_that_grows_end_it_too(stream, when, ending):
    (reported,) = warned(streams=[stream, IMU], contexts=[a_context(when=when)])
    assert reported.endswith(ending)


CAM = {"name": "cam", "key": "robot/cam", "producedBy": "vision"}
MAP = {"name": "map", "key": "robot/map", "producedBy": "mapper"}
SEES = a_context("sees", "cam.people > 1", suspends="speech")
HEARS = a_context("hears", "mic.level > 1", suspends="vision")
TRIO = [a_task("speech"), a_task("vision"), a_task("slam")]
TOGETHER = "nothing else ends them, so once all hold they hold for ever"


def test_two_contexts_that_suspend_each_others_producer_latch_together():
    assert warned(streams=[MIC, CAM, IMU], tasks=TRIO, contexts=[SEES, HEARS]) == [
        (
            "contexts sees and hears keep each other active: sees suspends speech, which produces mic; "
            f"hears suspends vision, which produces cam; {TOGETHER}"
        )
    ]


@pytest.mark.parametrize(
    "second",
    [
        a_context("hears", "mic.level > 1 && imu.x > 1", suspends="vision"),
        a_context("hears", "mic.level > 1", suspends="vision", until="imu.x > 1"),
        a_context("hears", "mic.level > 1", suspends="slam"),
        a_context("hears", "mic.level > 1 && cam.people < 1", suspends="vision"),
    ],
)
def test_exclusive_or_otherwise_ended_contexts_do_not_latch(second):
    assert warned(streams=[MIC, CAM, IMU], tasks=TRIO, contexts=[SEES, second]) == []


def test_a_stale_stream_breaks_the_circle_and_a_fallback_may_be_part_of_one():
    assert warned(streams=[STALE, CAM, IMU], tasks=TRIO, contexts=[SEES, HEARS]) == []
    safe = {"name": "safe", "tasks": {"vision": {"suspend": True}}}
    reported = warned(streams=[STALE, CAM, IMU], tasks=TRIO, contexts=[SEES, safe], fallback="safe")
    assert reported == [
        "context sees suspends speech: its stream mic is silent then, which begins the fallback safe, beside sees",
        (
            "contexts sees and safe keep each other active: sees suspends speech, which produces mic; "
            f"safe suspends vision, which produces cam; {TOGETHER}"
        ),
    ]


def test_three_contexts_in_a_circle_latch_together():
    lidar = {"name": "lidar", "key": "robot/lidar", "producedBy": "slam"}
    third = a_context("blocked", "lidar.near < 1", suspends="vision")
    contexts = [SEES, a_context("hears", "mic.level > 1", suspends="slam"), third]
    (reported,) = warned(streams=[MIC, CAM, lidar], tasks=TRIO, contexts=contexts)
    assert reported.startswith("contexts sees and hears and blocked keep each other")


def test_many_contexts_in_a_circle_are_named_together():
    names = [f"t{number}" for number in range(20)]
    streams = [{"name": f"s{name}", "key": name, "producedBy": name} for name in names]
    ring = [
        a_context(f"c{one}", f"s{one}.{'x' * 60} > 1", suspends=other)
        for one, other in zip(names, [*names[1:], names[0]], strict=True)
    ]
    (reported,) = warned(streams=streams, tasks=[*map(a_task, names), a_task("slam")], contexts=ring)
    assert reported.endswith(TOGETHER)


@pytest.mark.parametrize(
    ("mapper", "latches"),
    [
        ({"activity": [{"stream": "cam", "hold": "2s"}]}, True),
        ({"activity": [{"when": "contexts.seen", "hold": "2s"}]}, True),
        ({"requires": [{"when": "cam.ok", "hold": "2s"}]}, True),
        ({"requires": [{"when": "!contexts.busy"}]}, True),
        ({"activity": [{"when": "!contexts.busy"}]}, True),
        ({"activity": [{"stream": "cam"}]}, False),
        ({"activity": [{"stream": "cam", "hold": "2s"}], "idle": 0.1}, False),
        ({"activity": [{"stream": "cam", "hold": "2s"}, {"stream": "imu"}]}, False),
        ({"requires": [{"when": "cam.ok"}]}, False),
    ],
)
def test_it_is_followed_through_idle_tasks(mapper, latches):
    seen = a_context("seen", "cam.people > 1", suspends="slam")
    busy = a_context("busy", "map.size > 3", suspends="vision")
    tasks = [a_task("vision"), a_task("mapper", **mapper), a_task("slam")]
    reported = warned(streams=[CAM, MAP, IMU], tasks=tasks, contexts=[seen, busy])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches
    assert all(one.startswith("context busy ") and "mapper, which produces map" in one for one in reported)


def test_it_is_followed_through_contexts_that_suspend_producers():
    tidy = a_context("tidy", "contexts.full", suspends="mapper")
    full = a_context("full", "map.size > 3", suspends="")
    tasks = [a_task("mapper"), a_task("slam")]
    (reported,) = warned(streams=[MAP], tasks=tasks, contexts=[full, tidy])
    assert reported == f"context tidy suspends mapper, which produces map: {LATCHED}"


def test_a_later_context_may_let_it_run():
    later = {"name": "talk", "when": "imu.x > 1", "exitAfter": "1s", "tasks": {"speech": {"suspend": False}}}
    assert warned(contexts=[a_context(), later]) == []


def test_one_of_several_ways_is_not_a_latch():
    group = {"name": "talk", "subtasks": ["speech", "slam"], "satisfiedBy": "Any"}
    assert warned(tasks=[*TASKS, group], contexts=[a_context(suspends="slam")]) == []


def test_a_suspended_producer_begins_the_fallback():
    contexts = [a_context(when="imu.x > 1"), {"name": "safe", "tasks": {"slam": {"weight": 1}}}]
    assert warned(streams=[STALE, IMU], contexts=contexts, fallback="safe") == [
        "context quiet suspends speech: its stream mic is silent then, which begins the fallback safe, beside quiet"
    ]
    (reported,) = warned(streams=[{**STALE, "fallback": "safe"}, IMU], contexts=contexts)
    assert reported.endswith("which begins the fallback safe, beside quiet")
    assert warned(contexts=contexts, fallback="safe", streams=[MIC, {**IMU, "staleAfter": "1s"}]) == []


def test_a_fallback_that_suspends_the_producer_holds_for_ever():
    safe = {"name": "safe", "tasks": {"speech": {"suspend": True}}}
    (reported,) = warned(streams=[STALE, IMU], contexts=[safe], fallback="safe")
    assert reported.endswith("begins the fallback safe, which then holds for ever")


@pytest.mark.parametrize("idle", [{"idle": 0}, {}])
def test_a_task_that_only_its_own_output_wakes(idle):
    asleep = a_task("speech", **idle, activity=[{"when": "mic.level > 0.1"}])
    assert warned(tasks=[asleep, a_task("slam")], contexts=()) == [
        "nothing wakes speech without mic, which speech itself produces"
    ]
    either = [{"when": "mic.level > 0.1"}, {"stream": "imu"}]
    assert warned(tasks=[{**asleep, "activity": either}, a_task("slam")], contexts=()) == []
    assert warned(tasks=[{**asleep, "idle": 0.1}, a_task("slam")], contexts=()) == []
    woken = {"name": "now", "when": "imu.x > 1", "exitAfter": "1s", "tasks": {"speech": {"weight": 1}}}
    assert warned(tasks=[asleep, a_task("slam")], contexts=[woken]) == []


@pytest.mark.parametrize(
    "activity",
    [
        {"when": "contexts.loud", "hold": "3s"},
        {"when": "contexts.loud"},
        {"when": "mic.level > 0.1 && imu.x > 1", "hold": "1s"},
        {"stream": "mic", "when": "imu.x > 1"},
        {"when": "imu.x > 1", "scoreFrom": "mic.level"},
        {"when": "mic.often < 1.0"},
    ],
)
def test_its_own_output_may_be_part_of_a_condition(activity):
    loud = a_context("loud", "mic.level > 1", suspends="")
    reported = warned(
        tasks=[a_task("speech", activity=[activity]), a_task("slam")], contexts=[loud], streams=[COUNTED, IMU]
    )
    assert reported == ["nothing wakes speech without mic, which speech itself produces"]
    either = [activity, {"when": "contexts.loud || imu.x > 1"}]
    assert (
        warned(tasks=[a_task("speech", activity=either), a_task("slam")], contexts=[loud], streams=[COUNTED, IMU]) == []
    )


def test_tasks_that_wait_for_each_other_sleep_for_ever():
    tasks = [a_task("speech", activity=[{"stream": "cam"}]), a_task("vision", activity=[{"stream": "mic"}])]
    assert warned(streams=[MIC, CAM], tasks=[*tasks, a_task("slam")], contexts=()) == [
        "nothing wakes speech without cam, which vision produces",
        "nothing wakes vision without mic, which speech produces",
    ]
    awake = {**tasks[1], "idle": 0.1}
    assert warned(streams=[MIC, CAM], tasks=[tasks[0], awake, a_task("slam")], contexts=()) == []


def test_a_pre_condition_may_wait_for_the_task_itself_through_a_context():
    loud = a_context("loud", "mic.level > 1", suspends="")
    tasks = [a_task("speech", requires=[{"when": "contexts.loud"}]), a_task("slam")]
    assert warned(tasks=tasks, contexts=[loud]) == ["nothing lets speech run without mic, which speech itself produces"]
    tasks = [a_task("speech", requires=[{"when": "!contexts.loud"}]), a_task("slam")]
    (reported,) = warned(tasks=tasks, contexts=[loud])
    assert reported.endswith(LATCHED)


def test_a_pre_condition_that_suspends_a_producer_begins_the_fallback():
    safe = {"name": "safe", "tasks": {"slam": {"weight": 1}}}
    tasks = [a_task("speech", requires=[{"when": "imu.x > 1"}]), a_task("slam")]
    assert warned(streams=[STALE, IMU], tasks=tasks, contexts=[safe], fallback="safe") == [
        (
            "an unmet pre-condition of speech suspends speech: "
            "its stream mic is silent then, which begins the fallback safe"
        )
    ]
    group = {"name": "talk", "subtasks": ["speech"], "requires": [{"when": "imu.x > 1"}]}
    reported = warned(streams=[STALE, IMU], tasks=[*TASKS, group], contexts=[safe], fallback="safe")
    assert len(reported) == 1
    assert warned(streams=[STALE, IMU], tasks=[a_task("speech"), tasks[1]], contexts=[safe], fallback="safe") == []


def test_a_task_that_sleeps_from_the_start_begins_the_fallback():
    asleep = a_task("speech", idle=0, activity=[{"stream": "imu"}])
    safe = {"name": "safe", "tasks": {"slam": {"weight": 1}}}
    (reported,) = warned(streams=[STALE, IMU], tasks=[asleep, a_task("slam")], contexts=[safe], fallback="safe")
    assert reported.endswith("its stream mic is silent, which begins the fallback safe, from the start")


def test_idle_zero_without_activity_is_reported():
    (reported,) = warned(tasks=[a_task("speech", idle=0), a_task("slam")], contexts=())
    assert reported == "nothing wakes speech: it has idle 0 and no activity"


@pytest.mark.parametrize("key", ["a+b/s", "a/*/s"])
def test_a_plus_inside_a_name_is_not_reported(key):
    assert warned(streams=[MIC, {**IMU, "key": key}], contexts=()) == []


@pytest.mark.parametrize("op", ["rate", "count"])
def test_an_of_field_on_a_counting_feature_is_reported(op):
    features = [{"name": "often", "op": op, "over": "1s", "of": "mic.level"}]
    when = a_context(when="mic.often > 1.0", suspends="")
    (reported,) = warned(streams=[{**MIC, "features": features}, IMU], contexts=[when])
    assert reported.startswith(f"of has no effect on {op}")


@pytest.mark.parametrize("field", [{"realtimePolicy": "FIFO"}, {"realtimeFallback": "None"}])
def test_settings_of_realtime_under_cfs_are_reported(field):
    (reported,) = warned(contexts=(), enforcement=field)
    assert reported.endswith("has no effect without scheduler: Realtime")
    assert warned(contexts=(), enforcement={**field, "scheduler": "Realtime"}) == []


def test_an_earlier_context_does_not_lift_a_suspension():
    earlier = {"name": "talk", "when": "imu.x > 1", "exitAfter": "1s", "tasks": {"speech": {"suspend": False}}}
    reported = warned(contexts=[earlier, a_context()])
    assert f"context quiet suspends speech, which produces mic: {LATCHED}" in reported


@pytest.mark.parametrize("when", ["age(mic) > 5.0", "!heard(mic)"])
def test_a_task_woken_by_its_own_silence_is_not_reported(when):
    task = a_task("speech", activity=[{"when": when}])
    assert warned(tasks=[task, a_task("slam")], contexts=(), streams=[COUNTED, IMU]) == []
    held = a_task("speech", activity=[{"when": when, "hold": "1s"}])
    assert warned(tasks=[held, a_task("slam")], contexts=(), streams=[COUNTED, IMU]) != []


def test_a_suspended_producer_keeps_its_liveliness_token():
    safe = {"name": "safe", "tasks": {"slam": {"weight": 1}}}
    alive = {**MIC, "liveliness": "robot/mic"}
    assert warned(streams=[alive, IMU], contexts=[a_context(when="imu.x > 1"), safe], fallback="safe") == []


def test_a_context_that_others_read_changes_something():
    still = {"name": "still", "when": "imu.x < 1", "exitAfter": "1s"}
    assert warned(contexts=[still]) == ["context still changes no task"]
    for reader in ({"activity": [{"when": "contexts.still"}]}, {"requires": [{"when": "contexts.still"}]}):
        assert warned(contexts=[still], tasks=[a_task("speech", **reader), a_task("slam")]) == []
    assert warned(contexts=[still, a_context(when="contexts.still && imu.y > 1")]) == []


def test_a_context_that_cannot_hold_is_explained():
    effects = {"tasks": {"slam": {"weight": 2}}}
    assert warned(contexts=[{"name": "z", "when": "false", **effects}]) == [
        "context z can't hold: its condition is false, and it is neither the fallback nor forced"
    ]
    (reported,) = warned(contexts=[{"name": "z", **effects}])
    assert "it has no condition" in reported
    (reported,) = warned(contexts=[{"name": "z", **effects}], fallback="z")
    assert reported.startswith("never holds: no stream")


@pytest.mark.parametrize("streams", [[MIC, IMU], [STALE, IMU]])
@pytest.mark.parametrize("when", ["age(mic) > 5.0", "age(mic) >= 5.0"])
def test_an_age_that_only_grows_while_the_producer_is_suspended_latches(when, streams):
    (reported,) = warned(streams=streams, contexts=[a_context(when=when)])
    assert reported.endswith(LATCHED)
    assert warned(streams=streams, contexts=[a_context(when="imu.x > 1", until=when)]) == []


@pytest.mark.parametrize("other", ["imu.x > 1", "contexts.still"])
def test_one_of_several_conditions_latches(other):
    still = a_context("still", "imu.x > 1", suspends="")
    (reported,) = warned(contexts=[still, a_context(when=f"{other} || mic.level > 5")])
    assert reported.endswith("nothing else ends it, so once mic.level > 5 it holds for ever")


@pytest.mark.parametrize(
    ("until", "expected"),
    [("imu.x>1", "is the same as when"), ("true", "reads nothing"), ("1 > 2", "reads nothing"), ("imu.x > 2", None)],
)
def test_an_until_without_effect_is_reported(until, expected):
    when = {"when": "imu.x > 1", "until": until}
    for reported in (
        warned(contexts=[a_context(suspends="slam", **when)]),
        warned(contexts=(), tasks=[a_task("speech", activity=[when]), a_task("slam")]),
    ):
        assert [one for one in reported if expected and expected in one] == reported
        assert bool(reported) is bool(expected)


NEVER_BEGINS = "holds whenever when does: nothing begins while until holds, so this never does"
OVERLAPS = "overlaps with when, and nothing begins while until holds: it begins and ends at this one threshold"


@pytest.mark.parametrize(
    ("when", "until", "expected"),
    [
        ("imu.x < 20", "imu.x < 25", NEVER_BEGINS),
        ("imu.x < 20", "25 > imu.x", NEVER_BEGINS),
        ("imu.x <= -20", "imu.x < -19.5", NEVER_BEGINS),
        ("imu.x < 20", "!(imu.x >= 20)", NEVER_BEGINS),
        ("imu.x < 20 && imu.y", "imu.y", NEVER_BEGINS),
        ("imu.x < 20", "imu.y || imu.x < 20", NEVER_BEGINS),
        ("imu.x == 3", "imu.x > 2 && imu.x < 4", NEVER_BEGINS),
        ("imu.mode == 'idle'", "imu.mode != 'busy'", NEVER_BEGINS),
        ("imu.x < 20", "true || imu.x > 5", NEVER_BEGINS),
        ("norm(imu.v) > 2", "norm(imu.v) > 1", NEVER_BEGINS),
        ("imu.x < 20", "imu.x > 15", OVERLAPS),
        ("imu.x > 25", "30 >= imu.x", OVERLAPS),
        ("imu.at > '06:00'", "imu.at < '22:00'", OVERLAPS),
        ("imu.x <= 20", "imu.x >= 20", None),
        ("imu.x < 20", "imu.y > 15", None),
        ("imu.x < 20", "imu.x > 'a'", None),
        ("imu.x < 20", "imu.x > 15 && imu.y", None),
        ("imu.x < 20", "imu.x > 25", None),
        ("imu.x < 20", "imu.x < 19", None),
        ("imu.x < 20", "imu.x <= 20 && imu.y", None),
        ("imu.x < 20 || imu.y", "imu.x < 25", None),
        ("imu.y", "imu.x < 5 || imu.x >= 5", None),
        ("imu.mode == 'idle'", "imu.mode != 'idle'", None),
        ("imu.x > 1e300", "imu.x > 1e301", None),
        ("imu.x < 20", "imu.x > 25 && imu.x < 22", "never holds: it contradicts itself, so nothing ends it"),
        ("imu.x < 20", "imu.y && !imu.y", "never holds: it contradicts itself, so nothing ends it"),
        ("imu.x < 20 && imu.x > 25", "imu.x > 30", "never holds: it contradicts itself"),
        ("age(imu) > 5 && age(imu) < 2", "imu.x > 30", "never holds: it contradicts itself"),
    ],
)
def test_conditions_that_exclude_each_other_are_reported(when, until, expected):
    conditions = {"when": when, "until": until}
    for reported in (
        warned(contexts=[a_context(suspends="slam", **conditions)]),
        warned(contexts=(), tasks=[a_task("speech", activity=[conditions]), a_task("slam")]),
    ):
        assert reported == ([expected] if expected else [])


def test_a_pre_condition_that_contradicts_itself_is_reported():
    tasks = [a_task("speech", requires=[{"when": "imu.x > 1 && imu.x < 1"}]), a_task("slam")]
    assert warned(contexts=(), tasks=tasks) == ["never holds: it contradicts itself"]


def test_conditions_with_too_many_cases_are_not_reported():
    many = " && ".join(f"imu.x{number} > 1" for number in range(12))
    assert warned(contexts=[a_context(suspends="slam", when=many, until="imu.x0 > 0")]) == []


@pytest.mark.parametrize("when", ["lift.sources.exists(l, l.load > 1)", "lift.source == 'left'"])
def test_sources_that_are_not_kept_apart_are_reported(when):
    lift = {"name": "lift", "key": "lift/*"}
    context = a_context(when=when, suspends="")
    (reported,) = warned(streams=[lift], contexts=[context])
    assert reported.endswith("since stream lift has no sources, which would keep them apart")
    assert warned(streams=[{**lift, "sources": 2}], contexts=[context]) == []
    assert warned(streams=[{**lift, "key": "lift"}], contexts=[context]) == []


@pytest.mark.parametrize("when", ["size(imu) > 2", "norm(imu) > 2.0", "'a' in imu", "imu.exists(x, x == 'a')"])
def test_a_sample_that_is_walked_over_may_be_a_list(when):
    context = a_context(when=when, suspends="")
    (reported,) = warned(contexts=[context])
    assert reported.startswith("reads the fields of imu; a sample that is a list, such as [1, 2], is read as imu.value")
    assert warned(streams=[MIC, {**IMU, "example": {"x": 1, "z": 2}}], contexts=[context]) == []
    reported = warned(streams=[MIC, {**IMU, "filter": when}], contexts=[a_context(when="imu.x > 1", suspends="")])
    assert reported[0].startswith("reads the fields of imu")
