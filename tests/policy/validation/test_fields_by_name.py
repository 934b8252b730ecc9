"""`mic['level']` is `mic.level` in whatever `validate` finds."""

from __future__ import annotations

import pytest

from tests.policy.validation.loops import COUNTED, IMU, LATCHED, STALE, TASKS, a_context, a_task, advised, warned


def test_a_latch():
    (reported,) = warned(contexts=[a_context(when="mic['level'] < 0.1")])
    assert reported.endswith(LATCHED)


def test_an_empty_window_ends_a_context():
    assert warned(streams=[COUNTED, IMU], contexts=[a_context(when="imu.x > 1", until="mic['often'] < 1")]) == []


def test_a_chain_of_contexts():
    contexts = [a_context("calm", suspends=""), a_context(when="contexts[\"calm\"] && mic['level'] < 1")]
    (reported,) = warned(contexts=contexts)
    assert reported.endswith(LATCHED)


def test_a_field_that_is_asked_for():
    context = a_context(when="imu.x > 1", until="!has(mic.level) || mic['level'] > 0.3")
    assert warned(streams=[STALE, IMU], contexts=[context]) == []


@pytest.mark.parametrize(
    ("when", "until", "expected"),
    [
        ("mic['level'] < 0.1 && mic.level > 0.2", None, "never holds: it contradicts itself"),
        ("mic['level'] > 0.1", 'mic["level"] > 0.1', "is the same as when"),
        ("mic['level'] > 0.1", "mic.level > 0.1", "is the same as when"),
        ("mic['level'] > 0.2", "mic.level > 0.1", "holds whenever when does"),
        ("mic['level'] > 0.2", "mic.level < 0.3", "overlaps with when"),
        ("mic['often'] < 0", None, "never holds, whatever mic sends"),
    ],
)
def test_thresholds(when, until, expected):
    contexts = [a_context(when=when, suspends="", **({"until": until} if until else {}))]
    assert [one for one in advised(streams=[COUNTED, IMU], contexts=contexts) if expected in one]


def test_a_last_value_that_lets_a_task_run_on():
    tasks = [a_task("speech"), a_task("slam", requires=[{"when": "mic['level'] > 0.1"}])]
    reported = advised(tasks=tasks, contexts=[a_context(when="imu.x > 1")])
    assert [one for one in reported if "keeps running on its last sample" in one]


def test_sources_by_name():
    lifts = {"name": "lift", "key": "robot/lift/*", "sources": 2}
    contexts = [a_context(when="lift['sources'][2]['level'] > 1", suspends="")]
    assert [one for one in advised(streams=[lifts], contexts=contexts, tasks=TASKS) if "has no [2]" in one]
