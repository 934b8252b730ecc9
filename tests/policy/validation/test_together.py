"""Contexts that can't hold at the same time neither keep each other nor let run what the other suspends."""

from __future__ import annotations

import pytest

from tests.policy.validation.loops import IMU, LATCHED, MIC, a_context, a_task, warned

CAM = {"name": "cam", "key": "robot/cam", "producedBy": "vision"}
TASKS = [a_task("speech"), a_task("vision"), a_task("slam")]
SEES = a_context("sees", "cam.people > 1", suspends="speech")
HEARS = a_context("hears", "mic.level > 1", suspends="vision")


def rings(sees, hears, *others, **spec):
    reported = warned(
        streams=[MIC, CAM, IMU], tasks=TASKS, contexts=[{**SEES, **sees}, {**HEARS, **hears}, *others], **spec
    )
    return [one for one in reported if one.startswith("contexts sees and hears keep each other active")]


SUDDEN = {"exitAfter": "0s"}
MANY = {"when": "cam.people > 5", "until": "cam.people < 4"}
FEW = {"when": "mic.level > 1 && cam.people < 3", "until": "cam.people > 4 || mic.level < 1"}


@pytest.mark.parametrize(
    ("sees", "hears", "keep"),
    [
        ({}, {}, True),
        ({}, {"when": "mic.level > 1 && cam.people < 1"}, False),
        ({}, {"when": "mic.level > 1 && !contexts.sees"}, False),
        ({}, {"when": "mic.level > 1 && contexts.sees"}, True),
        ({"until": "cam.people < 1"}, {"when": "mic.level > 1 && !contexts.sees"}, False),
        ({"until": "cam.people < 1"}, {"until": "mic.level < 0.5"}, True),
        ({**MANY, **SUDDEN}, {**FEW, **SUDDEN}, False),
        ({**MANY, **SUDDEN}, FEW, True),
        (MANY, FEW, True),
    ],
)
def test_contexts_that_exclude_each_other_do_not_keep_each_other(sees, hears, keep):
    assert bool(rings(sees, hears)) is keep


def test_a_filter_may_make_contexts_exclusive():
    spec = {"streams": [MIC, {**CAM, "filter": "cam.people < 1 || cam.people > 3"}, IMU], "tasks": TASKS}
    two = {**HEARS, "when": "mic.level > 1 && cam.people < 3"}
    assert [one for one in warned(contexts=[SEES, two], **spec) if "keep each other" in one] == []


def test_a_forced_context_may_coincide_with_any():
    force = {"context": "hears", "until": "2030-01-01T00:00:00Z"}
    assert rings({}, {"when": "mic.level > 1 && cam.people < 1"}, force=force)


@pytest.mark.parametrize(
    ("when", "latches"),
    [("mic.level > 3", True), ("imu.x > 1", False), ("!contexts.quiet", True), ("mic.x > 3", False)],
)
def test_only_a_context_that_may_hold_beside_it_lets_a_task_run(when, latches):
    talk = {"name": "talk", "when": when, "tasks": {"speech": {"suspend": False}}}
    reported = warned(contexts=[a_context(), talk])
    assert [one for one in reported if one.endswith(LATCHED)] != [] or not latches
    assert bool([one for one in reported if one.endswith(LATCHED)]) is latches
