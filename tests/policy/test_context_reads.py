"""Which conditions over contexts are allowed, and the findings for others."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.context_reads import Dependencies
from contextpolicy.policy.validation.mistakes import mistakes_in
from tests.planning.builders import a_context, a_policy, a_stream, a_task


def refusals(*contexts: Any, **spec: Any) -> list[str]:
    spec = {"streams": [a_stream("imu")], "tasks": [a_task("slam")], **spec}
    with pytest.raises(PolicyError) as caught:
        a_policy(contexts=list(contexts), **spec)
    return [str(finding) for finding in caught.value.findings]


@pytest.mark.parametrize(
    ("source", "read"),
    [
        ("contexts.moving", {"moving"}),
        ("contexts['low-battery'] || !contexts.moving", {"low-battery", "moving"}),
        ('contexts["moving"] && imu.list.exists(c, c > 0 && contexts.still)', {"moving", "still"}),
        ("contexts.moving ? imu.x > 1 : contexts.still", {"moving", "still"}),
    ],
)
def test_contexts_that_an_expression_reads(source: str, read: set[str]) -> None:
    expression = Expression(source)
    assert expression.contexts == read
    assert expression.variables <= {"imu"}


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("contexts.nowhere", "invalid value 'nowhere': expected a context of this policy: one of low-battery, moving"),
        ("contexts.movin", "did you mean moving?"),
        ("contexts.low-battery", "contexts.low-battery is a subtraction: write contexts['low-battery']"),
        ("contexts", "one context, such as contexts.moving"),
        ("contexts.exists(c, c)", "one context, such as contexts.moving"),
        ("has(contexts.moving)", "one context, such as contexts.moving"),
        ("contexts[imu.name]", "a quoted name, such as contexts['low-battery']"),
        ("imu.list.exists(contexts, contexts > 1)", "one context, such as contexts.moving"),
    ],
)
def test_an_unknown_context_is_refused(source: str, expected: str) -> None:
    found = refusals(a_context("moving", "imu.x > 0"), a_context("low-battery", "imu.x > 1"), a_context("on", source))
    assert any(expected in finding for finding in found)
    assert all(finding.startswith("spec.contexts[2].when: ") for finding in found)


CYCLES: list[tuple[list[Any], str]] = [
    (
        [a_context("a", "contexts.a")],
        "spec.contexts[0]: invalid value 'a -> a': expected no cycle of contexts: a reads a",
    ),
    (
        [a_context("x", "imu.x > 0"), a_context("b", "contexts.c"), a_context("c", "imu.x > 0", until="contexts.b")],
        "spec.contexts[1]: invalid value 'b -> c -> b': expected no cycle of contexts: b reads c, c reads b",
    ),
]


@pytest.mark.parametrize(("contexts", "expected"), CYCLES)
def test_a_cycle_is_refused_with_its_path(contexts: list[Any], expected: str) -> None:
    assert refusals(*contexts) == [expected]


def test_the_path_of_a_cycle_goes_from_reader_to_what_it_reads() -> None:
    reads = {"d": ["b"], "a": ["b"], "b": ["c"], "c": ["a"]}
    assert Dependencies(reads).cycle() == ["a", "b", "c", "a"]
    assert Dependencies({"a": ["b"], "b": ["c"], "c": []}).cycle() is None


def test_ranks_follow_what_is_read() -> None:
    assert Dependencies({"a": ["b", "c"], "b": ["c"], "c": []}).ranks() == {"c": 0, "b": 1, "a": 2}


def test_streams_cannot_read_contexts() -> None:
    streams = [a_stream("imu", filter="contexts.moving")]
    allowed = "a condition on the sample alone, without contexts"
    expected = f"spec.streams[0].filter: invalid value 'contexts.moving': expected {allowed}"
    assert refusals(a_context("moving", "imu.x > 0"), streams=streams) == [expected]


def test_no_stream_may_be_named_contexts() -> None:
    assert any("reserved word of CEL" in expected for expected in refusals(streams=[a_stream("contexts")]))


@pytest.mark.parametrize(
    ("source", "expected"), [("contexts.moving", []), ("contexts.moving > 1.0", ["contexts.moving > 1.0"])]
)
def test_a_context_is_true_or_false(source: str, expected: list[str]) -> None:
    policy = a_policy(
        streams=[a_stream("imu")],
        tasks=[a_task("slam")],
        contexts=[a_context("moving", "imu.x > 0"), a_context("on", source)],
    )
    assert [finding.value for finding in mistakes_in(policy)] == expected
