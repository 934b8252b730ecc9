"""Conditions over contexts: evaluated after them, once an instant, whatever the order in the list."""

from __future__ import annotations

from itertools import permutations
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import context_sentences
from contextpolicy.planning.planner import Planner
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy

STREAMS = [a_stream("imu"), a_stream("dock")]
WATCHED = [a_stream("imu", staleAfter="5s"), a_stream("dock")]
MOVING = a_context("moving", "imu.speed > 0")
DOCKED = a_context("docked-in", "dock.contact")
FREE = a_context("free", "contexts.moving && !contexts['docked-in']", {"slam": {"weight": 7}})


def policy_of(*contexts: Any, streams: Any = STREAMS, **task: Any) -> Policy:
    return a_policy(streams=streams, tasks=[a_task("slam", **task), a_task("speech")], contexts=list(contexts))


def drive(story: Story, *readings: tuple[float, float]) -> None:
    for at, speed in readings:
        story.sample("imu", at=at, speed=speed)


@pytest.mark.parametrize("order", [*permutations([MOVING, DOCKED, FREE])])
def test_a_context_follows_those_that_it_reads_in_any_order(order: Any) -> None:
    story = Story(policy_of(*order))
    drive(story, (1, 1.0))
    story.sample("dock", at=2, contact=True)
    story.sample("dock", at=3, contact=False)
    drive(story, (4, 0.0))
    names = [context["name"] for context in order]
    expected = [(1, {"moving", "free"}), (2, {"moving", "docked-in"}), (3, {"moving", "free"}), (4, set())]
    assert story.contexts_over_time() == [
        (0, ()),
        *((at, tuple(name for name in names if name in active)) for at, active in expected),
    ]
    assert story.planner.transitions == {"moving": 2, "docked-in": 2, "free": 4}


def test_a_chain_settles_at_the_instant_of_the_sample() -> None:
    chain = [a_context(f"c{n}", f"contexts.c{n - 1}") for n in range(8, 0, -1)]
    story = Story(policy_of(*chain, a_context("c0", "imu.speed > 0")))
    drive(story, (1, 1.0), (2, 0.0))
    assert [(at, len(active)) for at, active in story.contexts_over_time()] == [(0, 0), (1, 9), (2, 0)]


@pytest.mark.parametrize("delays", [{}, {"enterAfter": "1s"}])
def test_simultaneous_context_changes_are_atomic(delays: Any) -> None:
    one, other = a_context("one", "imu.speed > 0", **delays), a_context("other", "imu.speed > 0", **delays)
    only = a_context("only", "contexts.one != contexts.other", exitAfter="9s")
    alert = {"when": "contexts.one != contexts.other", "hold": "60s"}
    story = Story(policy_of(only, one, other, activity=[alert]))
    drive(story, (1, 1.0), (3, 0.0))
    story.wait(9)
    assert story.planner.transitions["only"] == 0
    assert story.planner.scores()["slam"] == 0


def test_a_reader_of_a_stream_and_a_context_sees_both_as_of_the_sample() -> None:
    alert = {"when": "imu.speed > 0 && !contexts.moving", "hold": "60s"}
    story = Story(policy_of(MOVING, activity=[alert]))
    drive(story, (1, 1.0), (2, 2.0))
    assert story.planner.scores()["slam"] == 0


def test_delays_of_both_add_up() -> None:
    moving = a_context("moving", "imu.speed > 0", enterAfter="1s", exitAfter="1s")
    story = Story(policy_of(moving, a_context("under-way", "contexts.moving", enterAfter="2s")))
    drive(story, (1, 1.0), (5, 0.0))
    story.wait(9)
    expected = [(0, ()), (2, ("moving",)), (4, ("moving", "under-way")), (6, ())]
    assert story.contexts_over_time() == expected


def test_activities_pre_conditions_and_scores_may_read_contexts() -> None:
    fields = {
        "idle": 0,
        "activity": [{"when": "contexts.moving", "scoreFrom": "contexts['docked-in'] ? 3.0 : 2.0"}],
        "requires": [{"when": "contexts.moving || contexts['docked-in']"}],
    }
    story = Story(policy_of(MOVING, DOCKED, **fields))
    assert story.last.tasks["slam"].because.startswith("waits for contexts.moving")
    drive(story, (1, 1.0))
    assert story.planner.scores()["slam"] == 2
    assert "context moving" in story.last.cause
    story.sample("dock", at=2, contact=True)
    assert story.planner.scores()["slam"] == 3


def test_until_may_read_contexts() -> None:
    story = Story(policy_of(DOCKED, a_context("low", "imu.charge < 20", until="contexts['docked-in']")))
    story.sample("imu", at=1, charge=10)
    story.sample("imu", at=2, charge=90)
    story.sample("dock", at=3, contact=True)
    assert story.contexts_over_time()[-2:] == [(1, ("low",)), (3, ("docked-in",))]


def test_a_lost_stream_is_seen_through_contexts() -> None:
    still = a_context("still", "!contexts.moving")
    story = Story(policy_of(MOVING, still, streams=WATCHED))
    drive(story, (1, 1.0))
    story.wait(9)
    assert story.contexts_over_time()[-2:] == [(1, ("moving",)), (6, ("still",))]


def test_a_forced_context_counts_as_active() -> None:
    force = {"context": "moving", "until": "1970-01-01T00:16:43Z"}
    policy = a_policy(streams=STREAMS, tasks=[a_task("slam")], contexts=[FREE, MOVING, DOCKED], force=force)
    story = Story(policy)
    assert story.last.contexts == ("free", "moving")
    story.wait(9)
    assert story.contexts_over_time()[-1] == (3, ())


def test_the_fallback_counts_as_active() -> None:
    contexts = [a_context("lost"), a_context("alone", "contexts.lost", enterAfter="2s")]
    story = Story(a_policy(streams=WATCHED, tasks=[a_task("slam")], contexts=contexts, fallback="lost"))
    story.wait(9)
    assert story.contexts_over_time()[-2:] == [(5, ("lost",)), (7, ("lost", "alone"))]


EDITS: list[tuple[Any, bool]] = [
    ([DOCKED, FREE, MOVING], True),
    ([a_context("moving", "imu.speed > 0", exitAfter="1s"), DOCKED, FREE], True),
    ([a_context("moving", "imu.speed > 0.5"), DOCKED, FREE], False),
]


@pytest.mark.parametrize(("contexts", "kept"), EDITS)
def test_an_edit_keeps_activities_of_unchanged_contexts(contexts: Any, *, kept: bool) -> None:
    alert = {"when": "contexts.free", "hold": "60s"}
    story = Story(policy_of(MOVING, DOCKED, FREE, activity=[alert]))
    drive(story, (1, 1.0), (2, 0.0))
    planner = Planner(policy_of(*contexts, activity=[alert]), Quiet(), {})
    planner.start(START + 3, story.planner)
    assert planner.scores()["slam"] == (1 if kept else 0)


def test_an_edit_keeps_active_contexts() -> None:
    story = Story(policy_of(MOVING, DOCKED, FREE))
    drive(story, (1, 1.0))
    planner = Planner(policy_of(FREE, MOVING, DOCKED, a_context("new", "contexts.free")), Quiet(), {})
    planner.start(START + 2, story.planner)
    assert [context.spec.name for context in planner.active_contexts()] == ["free", "moving", "new"]
    assert planner.transitions["free"] == planner.transitions["moving"] == 0


def test_explanations_name_the_context_that_decides() -> None:
    story = Story(policy_of(MOVING, DOCKED, FREE))
    drive(story, (1, 1.0))
    story.sample("dock", at=2, contact=True)
    reported = context_sentences(explain(story.planner, START + 2))[-1]
    assert reported == "Context free does not hold: `contexts['docked-in']` is true."
