"""What `explain` says of contexts, activities and pre-conditions that do not hold."""

from __future__ import annotations

import json
from typing import Any

import pytest

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import context_sentences, sentences
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

STREAMS = [
    a_stream("mic", staleAfter="5s", features=[{"name": "peak", "op": "max", "of": "mic.level", "over": "1s"}]),
    a_stream("button"),
    a_stream("imu"),
]


def a_story(when="true", *, activity=None, requires=(), **context):
    tasks = [a_task("slam", activity=[activity] if activity else [], requires=list(requires))]
    contexts = [a_context("on", when, {"slam": {"weight": 3}}, **context)]
    story = Story(a_policy(streams=STREAMS, tasks=tasks, contexts=contexts))
    story.sample("mic", at=0, level=0.25)
    story.sample("imu", at=0, speed=0.5, ids=[1, 2])
    return story


def explained(story, at):
    story.wait(at)
    document = explain(story.planner, START + at)
    json.dumps(document, allow_nan=False)
    return document


SLOW = "`imu.speed > 1` is false, for `imu.speed` is 0.5"
UNHEARD = "`button.pressed` waits for stream button, never heard in 0.5 s"


@pytest.mark.parametrize(
    ("when", "parts"),
    [
        ("imu.speed > 1", [SLOW]),
        ("imu.speed > 0 && imu.speed > 1", [SLOW]),
        ("(imu.speed > 0 || heard(button)) && !(imu.speed < 1)", ["`imu.speed < 1` is true, for `imu.speed` is 0.5"]),
        ("imu.speed > 1 || 3 in imu.ids", [SLOW, "`3 in imu.ids` is false, for `imu.ids` is [1, 2]"]),
        ("button.pressed", [UNHEARD]),
        ("has(button.pressed)", ["`has(button.pressed)` is false"]),
        ("heard(button) ? true : imu.speed > 1", ["`heard(button)` is false", SLOW]),
        ("mic.level > 0.8 || button.pressed", ["`mic.level > 0.8` is false, for `mic.level` is 0.25", UNHEARD]),
        ("imu.speed > 0 && button.pressed", [UNHEARD]),
        ("imu.spead > 1", ["`imu.spead > 1` has no value: the sample has no field 'spead'"]),
        ("age(mic) > 3 && button.pressed", ["`age(mic) > 3` is false"]),
        (
            "imu.speed * 2 > mic.peak + 5",
            ["`imu.speed * 2 > mic.peak + 5` is false, for `imu.speed * 2` is 1 and `mic.peak + 5` is 5.25"],
        ),
        ("imu.ids.all(i, i > 1)", ["`imu.ids.all(i, i > 1)` is false"]),
    ],
)
def test_deciding_part_of_the_condition_is_named(when, parts):
    document = explained(a_story(when), 0.5)
    reported = f"Context on does not hold: {' and '.join(parts)}."
    assert context_sentences(document) == [reported]
    assert reported in sentences(document, "slam")


def test_silence_and_empty_windows_are_reported_with_their_time():
    story = a_story("mic.peak > 0.5")
    assert (
        "waits for stream mic: for 2 s mic.peak has no sample in its window"
        in context_sentences(explained(story, 3))[0]
    )
    assert "`mic.peak > 0.5` waits for stream mic, silent for 2 s" in context_sentences(explained(story, 7))[0]


def test_delays_are_reported():
    story = a_story("imu.speed < 1", enterAfter="10s", exitAfter="4s")
    assert context_sentences(explained(story, 4)) == [
        "Context on will hold in 6 s (enterAfter): `imu.speed < 1` is true, for `imu.speed` is 0.5."
    ]
    story.sample("imu", at=12, speed=2.0)
    assert context_sentences(explained(story, 13)) == [
        "Context on still holds, for 3 s more (exitAfter): `imu.speed < 1` is false, for `imu.speed` is 2."
    ]


ABSENT = "is not in force: it waits for stream button, never heard in 1 s"
FALSE = "is not in force: it is false, for `imu.speed` is 0.5"
ACTIVITIES: list[tuple[dict[str, Any], str]] = [
    ({"when": "imu.speed > 1"}, f"`imu.speed > 1` on imu {FALSE}"),
    ({"when": "button.pressed"}, f"`button.pressed` on button {ABSENT}"),
    ({"stream": "button"}, f"`true` on button {ABSENT}"),
    ({"scoreFrom": "imu.speed - 0.5"}, "`true` on imu is not in force: `imu.speed - 0.5` is 0"),
    ({"scoreFrom": "imu.ids"}, "`true` on imu is not in force: `imu.ids` is [1, 2]"),
    ({"when": "imu.speed > 1", "scoreFrom": "imu.speed"}, f"`imu.speed > 1` on imu {FALSE}"),
]


@pytest.mark.parametrize(("activity", "why"), ACTIVITIES)
def test_an_activity_reports_why_it_is_not_in_force(activity, why):
    assert f"Activity {why}." in sentences(explained(a_story(activity=activity), 1), "slam")


def test_a_pre_condition_reports_why_it_does_not_hold():
    reported = sentences(explained(a_story(requires=[{"when": "imu.speed > 1 || mic.level > 1"}]), 1), "slam")
    state = "Its pre-condition `imu.speed > 1 || mic.level > 1` does not hold, so it waits with weight 0"
    assert f"{state}: {SLOW} and `mic.level > 1` is false, for `mic.level` is 0.25." in reported


def test_values_that_json_cannot_hold_are_reported_as_texts():
    story = a_story("imu.far > 1 && imu.raw == b'a' && duration('1s') > duration('2s')")
    story.sample("imu", at=0.1, far=float("inf"), raw=b"a")
    assert (
        "`duration('1s') > duration('2s')` is false, for `duration('1s')` is \"0:00:01\""
        in context_sentences(explained(story, 1))[0]
    )
