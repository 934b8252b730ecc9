"""What still ends a context: `until` with `when`, what stays heard, and windows that empty."""

from __future__ import annotations

import pytest

from tests.planning import builders
from tests.planning.builders import Story
from tests.policy.validation.loops import COMES_AND_GOES, IMU, LATCHED, MIC, STALE, TASKS, a_context, a_task, warned

IF_LEVEL = "nothing else ends it, so once mic.level < 0.1 it holds for ever"


@pytest.mark.parametrize(
    ("when", "until", "ending"),
    [
        ("mic.level < 0.1", "mic.level > 0.3 && imu.x > 1", LATCHED),
        ("mic.level < 0.1 && imu.x > 1", "mic.level > 0.3 && imu.x < 0", LATCHED),
        ("mic.level < 0.1 || mic.level > 9", "mic.level > 0.3 && mic.level < 5 && imu.x > 1", LATCHED),
        ("mic.level < 0.1 || imu.x > 1", "mic.level > 0.3 && imu.x < 0", IF_LEVEL),
        ("mic.level < 0.1", "mic.level < 0.3 && imu.x > 1", None),
        ("mic.level < 0.1", "imu.x > 1 || mic.level > 0.3", None),
        ("imu.x > 1", "mic.level > 0.3 && imu.x < 0", None),
    ],
)
def test_until_is_evaluated_with_the_values_that_began_the_context(when, until, ending):
    reported = warned(contexts=[a_context(when=when, until=until)])
    assert [one.rpartition(": ")[2] for one in reported] == [ending] * bool(ending)


def test_starting_values_count_only_if_the_producer_stops_at_once():
    context = a_context(when="mic.level < 0.1", until="mic.level > 0.3 && imu.x > 1")
    assert warned(contexts=[context], enforcement={"minDwell": "1s"}) == []
    late = {"name": "talk", "when": "imu.y > 1", "exitAfter": "1s", "tasks": {"speech": {"suspend": False}}}
    assert (
        warned(contexts=[late, context])[-1].endswith("nothing else ends it, so once begun it holds for ever") is False
    )


def test_the_planner_never_ends_what_validate_calls_a_latch():
    context = a_context(when="mic.level < 0.1", until="mic.level > 0.3 && imu.x > 1")
    policy = builders.a_policy(streams=[MIC, IMU], tasks=TASKS, contexts=[context])
    story = Story(policy)
    story.sample("mic", at=1.0, level=0.0)
    assert story.plans[-1].tasks["speech"].suspended
    for second in range(2, 9):
        story.sample("imu", at=float(second), x=second % 3 - 1.0 + second)
    assert [one.spec.name for one in story.planner.active_contexts()] == ["quiet"]


@pytest.mark.parametrize(
    ("imu", "latches"),
    [(IMU, True), ({**IMU, "staleAfter": "1s"}, False), ({**IMU, "liveliness": "robot/imu"}, False)],
)
def test_a_stream_stays_heard_unless_it_may_go_stale(imu, latches):
    reported = warned(streams=[MIC, imu], contexts=[a_context(when="heard(imu) && mic.level < 0.1")])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches
    ends = {"when": "imu.x > 1", "until": "!heard(imu)"}
    for reported in (
        warned(streams=[MIC, imu], contexts=[a_context(suspends="slam", **ends)]),
        warned(streams=[MIC, imu], contexts=(), tasks=[a_task("speech", activity=[ends]), a_task("slam")]),
    ):
        expected = "never holds once when did: without staleAfter and liveliness imu stays heard for ever"
        assert reported == [expected] * latches


@pytest.mark.parametrize("until", ["heard(imu)", "!heard(mic) || imu.x < 1", "!heard(imu) && heard(imu) || imu.x < 1"])
def test_a_stream_that_may_change_ends_the_context(until):
    assert warned(contexts=[a_context(when="mic.x > 1", suspends="slam", until=until)]) == []


def windows(op):
    return {**MIC, "features": [{"name": "value", "op": op, "of": "mic.level", "over": "5s"}]}


@pytest.mark.parametrize(
    ("op", "until", "latches"),
    [
        ("min", "mic.value < 0.3", True),
        ("min", "mic.value > 0.3", False),
        ("max", "mic.value > 0.3", True),
        ("max", "mic.value < 0.3", False),
        ("mean", "mic.value > 0.3", False),
        ("mean", "mic.value < 0.3", False),
    ],
)
def test_the_least_of_an_emptying_window_only_rises_and_the_greatest_falls(op, until, latches):
    reported = warned(streams=[windows(op), IMU], contexts=[a_context(when="imu.x > 1", until=until)])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches


@pytest.mark.parametrize(("op", "kept"), [("min", [3.0, None]), ("max", [5.0, None]), ("mean", [4.0, None])])
def test_the_planner_empties_windows_the_same_way(op, kept):
    story = Story(builders.a_policy(streams=[windows(op)], tasks=TASKS))
    story.sample("mic", at=0.0, level=5.0 if op == "max" else 3.0)
    story.sample("mic", at=1.0, level=3.0 if op == "max" else 5.0)
    stream = story.planner.streams["mic"]
    assert [stream.features(builders.START + at)["value"] for at in (2.0, 7.0)] == kept


@pytest.mark.parametrize(
    ("until", "ending"),
    [
        ("(has(mic.level) ? mic.level : 1) > 0.5", None),
        ("(has(mic.level) ? mic.level : 0) > 0.5", LATCHED),
        ("(heard(mic) ? mic.level : 1) > 0.5", None),
        ("(!has(mic.level) || mic.level > 3 ? 'off' : 'on') == 'off'", None),
        ("has(mic.level) && mic.level > 0.5", LATCHED),
        ("[has(mic.level)].exists(one, !one)", None),
        ("mic.all.exists(one, has(one.x))", LATCHED),
        ("(imu.y ? mic.level : 1) > 0.5", None),
        ("(imu.y ? mic.level : mic.peak) > 0.5", LATCHED),
        ("(mic.off ? 1 : 2) > 1", LATCHED),
    ],
)
def test_a_conditional_on_has_needs_no_value(until, ending):
    reported = warned(streams=[STALE, IMU], contexts=[a_context(when="imu.x > 1", until=until)])
    assert [one.rpartition(": ")[2] for one in reported] == [ending] * bool(ending)


def test_silence_decides_a_conditional():
    (reported,) = warned(streams=[STALE, IMU], contexts=[a_context(when="(has(mic.level) ? mic.level : 0) > 0.5")])
    assert reported.endswith(COMES_AND_GOES)
