"""Several sources behind one stream: each keeps its latest sample, of a bounded number of them."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.conditions.sources import MOST_VALUES, TOO_LARGE, TOO_MANY
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.validation.mistakes import mistakes_in
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task
from tests.planning.quiet import Quiet

ANY, ALL = "lift.sources.exists(l, l.load > 10.0)", "lift.sources.all(l, l.load > 10.0)"
TWO = "lift.sources.filter(l, l.load > 10.0).size() >= 2"


def lifts(*conditions: str, tasks: Any = None, **fields: Any) -> Story:
    stream = {**a_stream("lift"), "key": "lift/*", "sources": 2, **fields}
    contexts = [a_context(f"ctx{number}", when) for number, when in enumerate(conditions)]
    return Story(a_policy(streams=[stream], tasks=tasks or [a_task("slam")], contexts=contexts))


def says(story: Story, key: str, *, at: float, stamp: float | None = None, **fields: Any) -> None:
    timestamp = None if stamp is None else START + stamp
    story.take(Sample("lift", fields, timestamp, None, f"lift/{key}"), at=at)


def active(story: Story) -> list[str]:
    return [context.spec.name for context in story.planner.active_contexts()]


def test_any_all_and_count_over_sources():
    story = lifts(ANY, ALL, TWO)
    says(story, "left", at=1, load=20)
    assert active(story) == ["ctx0", "ctx1"], "the only one that is known"
    says(story, "right", at=2, load=5)
    assert active(story) == ["ctx0"]
    says(story, "right", at=3, load=15)
    assert active(story) == ["ctx0", "ctx1", "ctx2"]
    says(story, "left", at=4, load=0)
    assert active(story) == ["ctx0"]


def test_without_the_field_the_latest_sample_of_all_counts():
    stream = {**a_stream("lift"), "key": "lift/*"}
    heavy = a_context("heavy", "lift.load > 10.0")
    story = Story(a_policy(streams=[stream], tasks=[a_task("slam")], contexts=[heavy]))
    says(story, "left", at=1, load=20)
    says(story, "right", at=2, load=5)
    assert active(story) == []


def test_a_sample_names_its_source():
    story = lifts(tasks=[a_task("slam", activity=[{"when": "lift.source == 'left'", "hold": "1s"}])])
    says(story, "right", at=1)
    assert story.weights() == {"slam": 0}
    says(story, "left", at=2)
    assert story.weights() == {"slam": 1}


def test_filters_and_features_see_the_source_too():
    features = [{"name": "lefts", "op": "max", "of": "lift.source == 'left' ? 1.0 : 0.0", "over": "5s"}]
    story = lifts("lift.lefts > 0.5", filter="lift.source != 'test'", features=features)
    says(story, "test", at=1)
    says(story, "right", at=2)
    assert active(story) == []
    assert story.drops() == {("lift", "filtered"): 1}
    says(story, "left", at=3)
    assert active(story) == ["ctx0"]


def test_a_source_that_is_filtered_takes_no_place():
    story = lifts("lift.sources.size() == 2", filter="lift.load >= 0.0")
    for key, load in (("broken", -1), ("left", 1), ("right", 1)):
        says(story, key, at=1, load=load)
    assert active(story) == ["ctx0"]


def test_samples_of_more_sources_are_dropped_and_counted():
    story = lifts("lift.sources.size() > 2", "lift.source == 'third'")
    for number, key in enumerate(("left", "right", "third", "left")):
        says(story, key, at=1 + number)
    assert active(story) == []
    assert story.drops() == {("lift", TOO_MANY): 1}


def test_a_silent_source_leaves_and_makes_room():
    story = lifts("lift.sources.exists(l, l.source == 'left')", "lift.sources.size() == 2", staleAfter="2s")
    says(story, "left", at=1)
    for at in (1.5, 2.5, 3.5):
        says(story, "right", at=at)
    assert story.contexts_over_time() == [(0, ()), (1, ("ctx0",)), (1.5, ("ctx0", "ctx1")), (3, ())]
    says(story, "third", at=4)
    assert active(story) == ["ctx1"]
    assert story.drops() == {}


def test_a_source_that_leaves_is_not_an_event():
    when = {"when": "lift.sources.size() == 1", "hold": "500ms"}
    story = lifts(tasks=[a_task("slam", activity=[when])], staleAfter="2s")
    says(story, "left", at=1)
    for at in (1.5, 2.5):
        says(story, "right", at=at)
    story.wait(3.25)
    assert story.weights() == {"slam": 0}


def test_a_silent_stream_has_no_sources_and_none_returns():
    story = lifts("lift.sources.size() == 1", "!heard(lift)", staleAfter="1s")
    says(story, "left", at=1)
    story.wait(2)
    assert active(story) == ["ctx1"]
    says(story, "right", at=3)
    assert active(story) == ["ctx0"]


def test_each_source_has_a_clock_of_its_own():
    story = lifts(ALL)
    says(story, "left", at=1, stamp=1.0, load=20)
    says(story, "right", at=1.1, stamp=0.5, load=20)
    assert story.drops() == {}
    says(story, "left", at=1.2, stamp=0.9, load=0)
    assert story.drops() == {("lift", "out of order"): 1}
    assert active(story) == ["ctx0"]


def test_a_sample_that_cel_cannot_represent_spoils_its_own_source_only():
    story = lifts(ANY, "lift.sources.size() == 2")
    says(story, "left", at=1, load=20)
    says(story, "right", at=2, load=2**70, odd={1: object()})
    says(story, "left", at=3, load=30)
    assert active(story) == ["ctx0"]
    assert story.drops() == {("lift", "expression"): 1}


def test_sources_share_the_bound_on_values():
    story = lifts("lift.sources.size() == 2")
    says(story, "left", at=1, list=[0] * (MOST_VALUES // 2 - 10))
    says(story, "right", at=2, list=[0] * (MOST_VALUES // 2))
    assert story.drops() == {("lift", TOO_LARGE): 1}
    assert active(story) == []


def test_an_edit_keeps_the_sources():
    story = lifts("lift.sources.size() == 2", staleAfter="5s")
    says(story, "left", at=1)
    says(story, "right", at=2)
    edited = Planner(story.planner.policy, Quiet(), {})
    edited.start(START + 3, story.planner)
    assert [context.spec.name for context in edited.active_contexts()] == ["ctx0"]
    edited.advance(START + 6)
    assert edited.active_contexts() == [], "left is silent since 1 s"


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"key": "lift/left"}, "only with wildcards in key"),
        ({"sources": 0}, "an integer from 1 to 16"),
        ({"sources": 17}, "an integer from 1 to 16"),
        ({"sources": 2.5}, "an integer from 1 to 16"),
        ({"sources": True}, "an integer from 1 to 16"),
        ({"debounce": "1s"}, "only without sources"),
        ({"sampleEvery": "1s"}, "only without sources"),
        ({"features": [{"name": "sources", "op": "count", "over": "1s"}]}, "another name"),
    ],
)
def test_sources_exclude_debounce_and_sample_every(fields, expected):
    with pytest.raises(PolicyError, match=expected):
        lifts(**fields)


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("lift.sources.exists(l, l.lode > 1.0)", "lode"),
        ("lift.source == 1", "a string"),
        ("lift.sources.exists(l, l.source)", "true or false"),
        ("lift.sources > 1", "a list"),
    ],
)
def test_expressions_are_checked_with_the_sources(when, expected):
    wrong = lifts(when, example={"load": 1.0}).planner.policy
    assert any(expected in finding.allowed for finding in mistakes_in(wrong))
    right = lifts("lift.sources.exists(l, l.load > 1.0 && l.source == 'left')", example={"load": 1.0}).planner.policy
    assert mistakes_in(right) == ()


@pytest.mark.parametrize("sources", [1, 2])
def test_a_source_leaves_before_a_sample_of_another_at_that_instant_counts(sources):
    when = {"when": f"lift.sources.size() == {sources}", "hold": "1s"}
    story = lifts(tasks=[a_task("slam", activity=[when])], staleAfter="2s", sources=sources)
    says(story, "left", at=1)
    says(story, "right", at=3)
    assert story.weights() == {"slam": 1 if sources == 1 else 0}
    says(story, "right", at=5)
    story.wait(5.5)
    assert story.weights() == {"slam": 1 if sources == 1 else 0}, "one that speaks at that instant stays"
