"""When tasks at rest run all the same: where nothing is active, and while an activity goes on."""

from __future__ import annotations

import pytest

from tests.planning import builders
from tests.planning.builders import Story
from tests.policy.validation.loops import IMU, LATCHED, MIC, STALE, a_context, a_task, warned

ASLEEP = a_task("speech", idle=0, activity=[{"when": "mic.level > 0.1"}])
IDLE = a_task("speech", idle=0)
SLAM = a_task("slam")


def sleeps(reported):
    return [one for one in reported if one.startswith("nothing wakes speech")]


@pytest.mark.parametrize("speech", [ASLEEP, IDLE])
@pytest.mark.parametrize(
    ("others", "contexts", "rests"),
    [
        ([], [], False),
        ([SLAM], [], True),
        ([{**SLAM, "activity": [{"when": "imu.x > 1"}]}], [], False),
        ([{**SLAM, "idle": 0.1, "activity": [{"when": "imu.x > 1"}]}], [], True),
        ([{**SLAM, "priority": 0}], [], False),
        ([{**SLAM, "requires": [{"when": "imu.x > 1"}]}], [], False),
        ([{**SLAM, "needs": {"cores": 1, "enforce": "Suspend"}}], [], False),
        ([SLAM], [a_context("docked", "imu.x > 1", suspends="slam")], False),
        ([{**SLAM, "protected": True}], [a_context("docked", "imu.x > 1", suspends="slam")], True),
        ([SLAM], [a_context("docked", "mic.level > 9", suspends="slam")], True),
        ([SLAM, {"name": "all", "subtasks": ["slam"]}], [], True),
        ([SLAM, {"name": "all", "subtasks": ["slam"]}], [a_context("docked", "imu.x > 1", suspends="all")], False),
    ],
)
def test_a_task_at_rest_sleeps_only_if_something_is_always_active(speech, others, contexts, rests):
    reported = sleeps(warned(tasks=[speech, *others], contexts=contexts))
    assert bool(reported) is rests


@pytest.mark.parametrize("others", [[], [SLAM]])
def test_the_planner_lets_it_run_where_nothing_else_is_active(others):
    story = Story(builders.a_policy(streams=[MIC], tasks=[ASLEEP, *others]))
    assert story.plans[-1].tasks["speech"].suspended is bool(others)


MAP = {"name": "map", "key": "robot/map", "producedBy": "mapper"}


@pytest.mark.parametrize(
    ("activity", "latches"),
    [
        ({"when": "mic.level > 1"}, True),
        ({"when": "mic.level > 1", "until": "mic.level < 0.5"}, False),
        ({"when": "mic.level > 1", "until": "mic.level < 0.5 || !heard(mic)"}, True),
        ({"when": "mic.level > 1", "until": "mic.level < 0.5", "hold": "2s"}, True),
        ({"stream": "mic", "until": "mic.level < 0.5"}, False),
        ({"when": "imu.x > 1", "scoreFrom": "mic.level", "until": "mic.level < 0.5"}, True),
    ],
)
def test_an_activity_may_go_on_through_the_silence(activity, latches):
    busy = a_context("busy", "map.size > 3")
    tasks = [a_task("speech"), a_task("mapper", activity=[activity]), SLAM]
    reported = warned(streams=[STALE, MAP, IMU], tasks=tasks, contexts=[busy])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches


def test_the_planner_lets_it_go_on():
    tasks = [a_task("mapper", activity=[{"when": "mic.level > 1", "until": "mic.level < 0.5"}]), a_task("speech"), SLAM]
    story = Story(builders.a_policy(streams=[STALE], tasks=tasks))
    story.sample("mic", at=1.0, level=2.0)
    story.wait(10.0)
    assert not story.plans[-1].tasks["mapper"].suspended


@pytest.mark.parametrize(
    ("stream", "latches"),
    [
        ({"key": "robot/speech/health"}, False),
        ({"key": "robot/speech/**"}, False),
        ({"key": "robot/speech/health", "filter": "!mic.suspended"}, True),
        ({"key": "robot/speech/health", "filter": "mic.queue > 2"}, False),
        ({"key": "robot/speech/level"}, True),
        ({"key": "arm/speech/health"}, True),
    ],
)
def test_a_suspended_module_reports_its_health(stream, latches):
    reported = warned(streams=[{**MIC, **stream}, IMU], contexts=[a_context(when="mic.misses > 0.1")])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches


def test_health_wakes_the_task_and_never_begins_its_fallback():
    health = {**STALE, "key": "robot/speech/health"}
    safe = {"name": "safe", "tasks": {"slam": {"weight": 1}}}
    reported = warned(streams=[health], tasks=[ASLEEP, SLAM], contexts=[safe], fallback="safe")
    assert reported == []
    reported = warned(streams=[health, IMU], contexts=[a_context(when="imu.x > 1"), safe], fallback="safe")
    assert reported == []
