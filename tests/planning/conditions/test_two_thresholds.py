"""`until` beside `when`: between the two thresholds a context, or an activity, stays as it is."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.explain.deciding import waits
from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import context_sentences, sentences
from contextpolicy.planning.planner import Planner
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task
from tests.planning.quiet import Quiet

LOW, CHARGED = "battery.level < 20", "battery.level > 25"
BATTERY = a_stream("battery", staleAfter="10s")


def policy_of(*, activity: Any = None, effects: Any = None, **context: Any) -> Any:
    tasks = [a_task("slam", idle=0, activity=[activity] if activity else []), a_task("speech")]
    contexts = [a_context("low", LOW, effects or {"speech": {"weight": 3}}, **context)] if activity is None else []
    return a_policy(streams=[BATTERY, a_stream("imu")], tasks=tasks, contexts=contexts)


def levels(story: Story, *readings: tuple[float, float]) -> None:
    for at, level in readings:
        story.sample("battery", at=at, level=level)


def test_a_context_stays_between_its_thresholds() -> None:
    story = Story(policy_of(until=CHARGED))
    levels(story, (1, 22), (2, 19), (3, 21), (4, 25), (5, 26), (6, 21), (7, 20))
    assert story.contexts_over_time() == [(0, ()), (2, ("low",)), (5, ())]


def test_delays_count_from_each_threshold() -> None:
    story = Story(policy_of(until=CHARGED, enterAfter="2s", exitAfter="3s"))
    levels(story, (1, 19), (2, 21), (3, 19), (4, 19), (5.5, 26), (6, 24), (7, 26), (8, 26), (9, 30))
    story.wait(15)
    assert story.contexts_over_time() == [(0, ()), (5, ("low",)), (10, ())]


def test_while_until_holds_the_context_does_not_begin() -> None:
    story = Story(policy_of(until="battery.charging"))
    story.sample("battery", at=1, level=10, charging=True)
    story.sample("battery", at=2, level=10, charging=False)
    story.sample("battery", at=3, level=10, charging=True)
    assert story.contexts_over_time() == [(0, ()), (2, ("low",)), (3, ())]


@pytest.mark.parametrize(("until", "lasts"), [(CHARGED, None), (f"{CHARGED} || !heard(battery)", 12)])
def test_a_lost_stream_keeps_the_context_unless_until_tests_for_it(until: str, lasts: float | None) -> None:
    story = Story(policy_of(until=until))
    levels(story, (1, 19), (2, 21))
    story.wait(30)
    ends = [] if lasts is None else [(lasts, ())]
    assert story.contexts_over_time() == [(0, ()), (1, ("low",)), *ends]


def test_an_age_can_end_it() -> None:
    story = Story(policy_of(until="age(battery) > 4"))
    levels(story, (1, 19), (2, 21))
    story.wait(9)
    assert story.contexts_over_time() == [(0, ()), (1, ("low",)), (6, ())]


def test_an_activity_stays_between_its_thresholds_and_then_decays() -> None:
    story = Story(policy_of(activity={"when": LOW, "until": CHARGED, "score": 2, "decay": "10s"}))
    scores = []
    for at, level in ((1, 22), (2, 19), (3, 24), (4, 26), (5, 22)):
        levels(story, (at, level))
        scores.append(story.planner.scores()["slam"])
    assert scores == [0, 2, 2, 2, 1.8]


def test_the_score_of_an_activity_follows_its_samples_between_the_thresholds() -> None:
    story = Story(policy_of(activity={"when": LOW, "until": CHARGED, "scoreFrom": "battery.level"}))
    levels(story, (1, 19), (2, 24))
    assert story.planner.scores()["slam"] == 24


def test_hold_bounds_an_activity_and_until_ends_it_earlier() -> None:
    story = Story(policy_of(activity={"when": LOW, "until": CHARGED, "hold": "5s"}))
    levels(story, (1, 19), (2, 21))
    story.wait(5.9)
    assert story.planner.scores()["slam"] == 1
    story.wait(6.1)
    assert story.planner.scores()["slam"] == 0
    levels(story, (7, 19), (8, 26))
    assert story.planner.scores()["slam"] == 0


EDITS: list[tuple[dict[str, Any], bool]] = [
    ({"until": CHARGED, "effects": {"speech": {"weight": 4}}}, True),
    ({"until": CHARGED, "exitAfter": "1s"}, True),
    ({"until": "battery.level > 30"}, False),
    ({}, False),
]


@pytest.mark.parametrize(("edited", "kept"), EDITS)
def test_an_edit_keeps_what_it_did_not_change(edited: dict[str, Any], *, kept: bool) -> None:
    story = Story(policy_of(until=CHARGED))
    levels(story, (1, 19), (2, 22))
    planner = Planner(policy_of(**edited), Quiet(), {})
    planner.start(START + 3, story.planner)
    assert [context.spec.name for context in planner.active_contexts()] == (["low"] if kept else [])


def test_an_edit_keeps_an_activity_between_its_thresholds() -> None:
    activity = {"when": LOW, "until": CHARGED}
    story = Story(policy_of(activity=activity))
    levels(story, (1, 19), (2, 22))
    planner = Planner(policy_of(activity=activity), Quiet(), {})
    planner.start(START + 3, story.planner)
    assert planner.scores()["slam"] == 1


def test_explanations_name_the_threshold_that_decides() -> None:
    story = Story(policy_of(until=CHARGED))
    levels(story, (1, 22))
    assert context_sentences(explain(story.planner, START + 1)) == [
        "Context low does not hold: `battery.level < 20` is false, for `battery.level` is 22."
    ]
    levels(story, (2, 19), (3, 22))
    assert context_sentences(explain(story.planner, START + 3)) == [
        "Context low holds until `battery.level > 25`: it is false, for `battery.level` is 22."
    ]


def test_explanations_of_an_activity_name_until() -> None:
    story = Story(policy_of(activity={"when": LOW, "until": CHARGED}))
    levels(story, (1, 19), (2, 22))
    reported = sentences(explain(story.planner, START + 2), "slam")
    assert "Activity `battery.level < 20` on battery is in force with score 1 until `battery.level > 25`." in reported


def test_an_active_context_waits_for_the_streams_of_until() -> None:
    story = Story(policy_of(until="imu.speed > 1"))
    levels(story, (1, 19))
    assert [(owner, waiting.stream) for owner, waiting in waits(story.planner)] == [("context low", "imu")]
