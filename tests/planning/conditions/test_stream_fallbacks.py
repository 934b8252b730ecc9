"""A silent stream activates the policy's fallback, or its own instead."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import context_sentences
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task
from tests.planning.quiet import Quiet

STREAMS = [
    a_stream("radio", staleAfter="2s", fallback="return-home"),
    a_stream("pad", liveliness="robot/pad", fallback="hover"),
    a_stream("imu", staleAfter="1s"),
]
CONTEXTS = [a_context("return-home"), a_context("hover"), a_context("careful")]


def policy_of(streams: Any = STREAMS, fallback: str | None = "careful") -> Any:
    named = {} if fallback is None else {"fallback": fallback}
    return a_policy(streams=streams, tasks=[a_task("slam")], contexts=CONTEXTS, **named)


def heard(policy: Any, **names: float) -> Story:
    story = Story(policy)
    for name, at in names.items():
        story.sample(name, at=at, x=1)
    return story


def active(story: Story) -> list[str]:
    return [context.spec.name for context in story.planner.active_contexts()]


def test_streams_without_a_fallback_use_that_of_the_policy() -> None:
    story = heard(policy_of(), radio=1, imu=1.5)
    assert active(story) == []
    story.wait(2.6)
    assert active(story) == ["careful"]
    story.wait(3.1)
    assert active(story) == ["return-home", "careful"]
    story.gone("pad", at=3.2)
    assert active(story) == ["return-home", "hover", "careful"]
    story.sample("radio", at=3.5, x=1)
    assert active(story) == ["hover", "careful"]


def test_a_policy_without_a_fallback_may_have_streams_with_one() -> None:
    story = heard(policy_of(fallback=None), imu=1.0, radio=1.0)
    story.wait(5)
    assert active(story) == ["return-home"]


def test_one_context_lasts_until_the_last_of_its_streams_is_heard() -> None:
    streams = [a_stream(name, staleAfter="1s", fallback="hover") for name in ("one", "two")]
    story = heard(policy_of(streams, fallback=None), one=1.0, two=1.0)
    story.wait(3)
    story.sample("one", at=3.5, x=1)
    assert active(story) == ["hover"]
    story.sample("two", at=3.6, x=1)
    assert active(story) == []


def test_explanations_say_that_it_is_a_fallback() -> None:
    story = heard(policy_of(), radio=1.0, imu=9.0)
    assert context_sentences(explain(story.planner, START + 9))[0] == "Context return-home holds: fallback."


def test_editing_a_fallback_keeps_the_state_of_the_stream() -> None:
    story = heard(policy_of(), radio=1.0, imu=1.0)
    streams = [{**STREAMS[0], "fallback": "hover"}, *STREAMS[1:]]
    planner = Planner(policy_of(streams), Quiet(), {})
    planner.start(START + 1.5, story.planner)
    assert planner.streams["radio"].value == {"x": 1}
    planner.advance(START + 3.1)
    assert [context.spec.name for context in planner.active_contexts()] == ["hover", "careful"]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"staleAfter": "1s", "fallback": "land"}, "spec.streams[0].fallback"),
        ({"fallback": "hover"}, "spec.streams[0].staleAfter"),
    ],
)
def test_a_fallback_that_cannot_work_is_refused(fields: Any, expected: str) -> None:
    with pytest.raises(PolicyError) as caught:
        policy_of([a_stream("radio", **fields)], fallback=None)
    assert [finding.field for finding in caught.value.findings] == [expected]


@pytest.mark.parametrize(
    ("streams", "expected"),
    [
        (STREAMS, []),
        (STREAMS[:2], ["spec.fallback"]),
    ],
)
def test_a_fallback_that_never_holds_is_reported(streams: Any, expected: list[str]) -> None:
    findings = [finding.field for finding in advice(policy_of(streams)) if "never holds" in finding.allowed]
    assert findings == expected
    unreachable = [finding for finding in advice(policy_of()) if "can't hold" in finding.allowed]
    assert unreachable == []


def test_the_cause_of_a_fallback_is_its_stream() -> None:
    streams = [a_stream("imu"), a_stream("radio", staleAfter="1s")]
    safe = a_context("safe", tasks={"slam": {"scale": 2}})
    story = Story(a_policy(streams=streams, tasks=[a_task("slam"), a_task("other")], fallback="safe", contexts=[safe]))
    story.wait(2)
    assert story.last.cause == "radio: context safe entered; radio: silent"
    story.sample("radio", at=3)
    assert story.last.cause == "radio: context safe exited; radio: heard again"
