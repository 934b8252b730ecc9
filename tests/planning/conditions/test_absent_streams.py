"""A stream that was never heard, or is silent, has no value: CEL decides without it where it can."""

from __future__ import annotations

import pytest

from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task


def watching(when, *, stale="2s", **fields):
    """One context over a microphone, a button and a gyroscope; the microphone can fall silent."""
    streams = [a_stream("mic", staleAfter=stale), a_stream("button"), a_stream("imu")]
    contexts = [a_context("on", when, **fields)]
    story = Story(a_policy(streams=streams, tasks=[a_task("slam")], contexts=contexts))
    story.sample("mic", at=0, peak=0.0)
    return story


def holds(story):
    return story.last.contexts == ("on",)


@pytest.mark.parametrize("when", ["mic.peak > 0.8 || button.pressed", "button.pressed || mic.peak > 0.8"])
def test_either_side_of_an_or_decides_alone(when):
    story = watching(when)
    story.sample("mic", at=1, peak=0.9)
    assert holds(story)
    story.sample("mic", at=1.5, peak=0.1)
    assert not holds(story)
    story.wait(4)
    story.sample("button", at=5, pressed=True)
    assert holds(story)


@pytest.mark.parametrize("when", ["!(mic.peak > 0.8 && button.pressed)", "!(button.pressed && mic.peak > 0.8)"])
def test_either_side_of_an_and_decides_alone(when):
    story = watching(when)
    assert holds(story)
    story.sample("mic", at=1, peak=0.9)
    assert not holds(story)


def test_an_expression_that_cannot_be_decided_is_false_and_no_error():
    story = watching("button.pressed")
    assert not holds(story)
    assert not story.planner.errors
    assert not story.drops()


@pytest.mark.parametrize(
    ("when", "unheard", "heard_without", "heard_with"),
    [
        ("has(button.pressed)", False, False, True),
        ("!has(button.pressed)", True, True, False),
        ("has(button.pressed) && button.pressed", False, False, True),
        ("!has(button.pressed.by[0].name)", True, False, False),
        ("heard(button)", False, True, True),
        ("!heard(button)", True, False, False),
        ("heard(button) ? button.pressed : mic.peak == 0", True, False, True),
        ("mic.peak == 0 && [1, 2].exists(n, has(button.pressed))", False, False, True),
        ("[{'a': 1}].exists(n, has(n.a))", True, True, True),
    ],
)
def test_has_and_heard_test_for_presence(when, unheard, heard_without, heard_with):
    story = watching(when, stale="1m")
    assert holds(story) is unheard
    story.sample("button", at=1, held=1)
    assert holds(story) is heard_without
    story.sample("button", at=2, pressed=True)
    assert holds(story) is heard_with


def test_a_silent_stream_is_not_heard_and_has_no_fields():
    story = watching("!heard(mic) && !has(mic.peak)")
    assert story.contexts_over_time() == [(0, ())]
    story.wait(10)
    story.sample("mic", at=11, peak=0.1)
    assert story.contexts_over_time() == [(0, ()), (2, ("on",)), (11, ())]


def test_other_streams_keep_their_values_when_one_falls_silent():
    story = watching("mic.peak > 0.8 || button.pressed")
    story.sample("button", at=0.5, pressed=True)
    story.sample("mic", at=1, peak=0.9)
    story.wait(10)
    assert holds(story)


AGES = [
    ("age(mic) > 0.5", [(0, ()), (0.5, ("on",)), (1, ()), (1.5, ("on",))]),
    ("age(mic) >= 0.5", [(0, ()), (0.5, ("on",)), (1, ()), (1.5, ("on",))]),
    ("0.5 < age(mic)", [(0, ()), (0.5, ("on",)), (1, ()), (1.5, ("on",))]),
    ("!(age(mic) < 0.5)", [(0, ()), (0.5, ("on",)), (1, ()), (1.5, ("on",))]),
    ("age(mic) <= 0.5", [(0, ("on",)), (0.5, ()), (1, ("on",)), (1.5, ())]),
    (
        "age(mic) > 0.25 && age(mic) < 0.75",
        [(0, ()), *((t + d, c) for t in (0, 1) for d, c in ((0.25, ("on",)), (0.75, ())))],
    ),
]


@pytest.mark.parametrize(("when", "expected"), AGES)
def test_an_age_changes_contexts_as_time_passes(when, expected):
    story = watching(when)
    story.sample("mic", at=1, peak=0.0)
    story.wait(30)
    assert story.contexts_over_time() == expected
    assert story.next_decision() is None


def test_an_age_continues_through_silence():
    story = watching("age(mic) > 10")
    story.wait(20)
    assert story.contexts_over_time() == [(0, ()), (10, ("on",))]


@pytest.mark.parametrize(
    ("when", "unheard", "heard"),
    [
        ("age(button) > 1.0", True, False),
        ("age(button) >= 1000000", True, False),
        ("age(button) < 1.0", False, True),
        ("!(age(button) <= 1.0)", True, False),
        ("!heard(button) && age(button) > 1.0", True, False),
        ("heard(button) && age(button) > 1.0", False, False),
    ],
)
def test_the_age_of_a_stream_that_was_never_heard_is_infinite(when, unheard, heard):
    story = watching(when)
    assert holds(story) is unheard
    story.wait(1)
    assert holds(story) is unheard
    story.sample("button", at=2, pressed=True)
    assert holds(story) is heard


def test_an_age_scores_too():
    streams = [a_stream("mic")]
    tasks = [a_task("slam", activity=[{"when": "age(mic) > 3", "score": 5}])]
    story = Story(a_policy(streams=streams, tasks=tasks))
    story.sample("mic", at=1, peak=1)
    story.wait(5)
    assert story.planner.scores() == {"slam": 5.0}
    story.sample("mic", at=6, peak=1)
    assert story.planner.scores() == {"slam": 0.0}


def test_a_condition_reports_which_stream_it_waits_for():
    story = watching("mic.peak > 0.8 && button.pressed")
    context = story.planner.contexts[0].when
    assert context is not None

    def waiting():
        return context.waiting

    assert waiting() is None
    story.sample("mic", at=1, peak=0.9)
    assert (waiting().stream, waiting().since) == ("button", START + 1)
    story.sample("mic", at=1.5, peak=0.95)
    assert waiting().since == START + 1
    story.sample("button", at=2, pressed=True)
    assert waiting() is None
    story.wait(9)
    assert (waiting().stream, waiting().since) == ("mic", START + 3.5)
    assert waiting().reason == "mic has no value"
