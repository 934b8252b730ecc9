"""A stream's filter says what its samples can be: validation takes it into account, as the planner does."""

from __future__ import annotations

import pytest

from tests.planning import builders
from tests.planning.builders import Story
from tests.policy.validation.loops import IMU, LATCHED, MIC, TASKS, a_context, warned

LOUD = {**MIC, "filter": "mic.level > 0.5"}
DROPPED = "never holds: the filter of stream mic drops what it asks for"


@pytest.mark.parametrize(
    ("when", "until", "expected"),
    [
        ("mic.level < 0.1", "imu.x > 1", DROPPED),
        ("imu.x > 1", "mic.level < 0.1", f"{DROPPED}, so nothing ends it"),
        ("imu.x > 1 && mic.level < 0.2", None, DROPPED),
        ("imu.x > 1", "mic.level < 0.1 || imu.x < 1", None),
        ("imu.x > 1", "mic.level < 0.7", None),
        ("!has(mic.level)", "imu.x > 1", None),
        ("!heard(mic)", "imu.x > 1", None),
        (
            "mic.level > 0.7",
            "mic.level > 0.4",
            "holds whenever when does: nothing begins while until holds, so this never does",
        ),
        ("imu.x > 1", "mic.level > 0.4", None),
    ],
)
def test_a_condition_on_filtered_values_is_reported(when, until, expected):
    fields = {} if until is None else {"until": until}
    reported = warned(streams=[LOUD, IMU], contexts=[a_context(when=when, suspends="slam", **fields)])
    assert reported == ([expected] if expected else [])


@pytest.mark.parametrize(
    ("stream", "latches"),
    [
        ({**MIC, "filter": "mic.level > 0.2"}, True),
        ({**MIC, "filter": "mic.level > 0.05"}, False),
        ({**MIC, "filter": "mic.ok"}, False),
        (MIC, False),
    ],
)
def test_a_filter_may_make_a_context_latch(stream, latches):
    context = a_context(when="imu.x > 1", until="mic.level < 0.1 && imu.x < 1 || mic.level > 0.3")
    reported = warned(streams=[stream, IMU], contexts=[context])
    assert [one.endswith(LATCHED) for one in reported] == [True] * latches


def test_a_feature_that_hides_a_field_is_not_what_the_filter_reads():
    hidden = {**LOUD, "features": [{"name": "level", "op": "rate", "over": "1s"}]}
    assert warned(streams=[hidden, IMU], contexts=[a_context(when="mic.level < 0.1", suspends="slam")]) == []


def test_the_planner_drops_filtered_samples():
    context = a_context(when="mic.level < 0.1", suspends="slam")
    story = Story(builders.a_policy(streams=[LOUD, IMU], tasks=TASKS, contexts=[context]))
    for second, level in enumerate((0.9, 0.05, 0.6, 0.0), start=1):
        story.sample("mic", at=float(second), level=level)
        assert story.planner.active_contexts() == []
