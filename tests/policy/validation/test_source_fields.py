"""Conditions on sources that a stream can't have."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import a_context, a_policy, a_stream, a_task


def reported(when, key="lift/*"):
    asked = a_context("asked", when, {"slam": {"weight": 2}}, enterAfter="1ms")
    lift = a_stream("lift", key=key, sources=2)
    policy = a_policy(streams=[lift], tasks=[a_task("slam"), a_task("rest")], contexts=[asked])
    return [one.allowed for one in advice(policy)]


NOT_LEFT = "no source of lift is 'lift/left': a source is what the wildcards of lift/* match"


@pytest.mark.parametrize(
    "when",
    [
        "lift.source == 'lift/left'",
        "'lift/left' != lift.source",
        "lift.sources[0].source == 'lift/left'",
        "lift.sources.exists(l, l.load > 1 && l.source == 'lift/left')",
        "lift.sources.filter(l, l.up).all(l, l.source == 'lift/left')",
        "lift.sources.exists(l, l.parts.all(p, p.up && l.source == 'lift/left'))",
    ],
)
def test_a_whole_key_is_not_a_source(when):
    assert reported(when) == [NOT_LEFT]


@pytest.mark.parametrize(
    ("when", "key"), [("lift.source == 'left'", "*/lift/*"), ("lift.source == '7'", "arm$*/joint")]
)
def test_a_source_is_all_that_the_wildcards_match(when, key):
    (one,) = reported(when, key)
    assert one.startswith("no source of lift is ")


@pytest.mark.parametrize("index", [2, -1])
@pytest.mark.parametrize("sources", ["lift.sources", "lift.sources.filter(l, l.up)"])
def test_an_index_beyond_the_sources_is_reported(sources, index):
    expected = f"lift.sources has no [{index}]: the first is [0], the last at most [1]"
    assert reported(f"{sources}[{index}].load > 1") == [expected]


@pytest.mark.parametrize(
    ("when", "key"),
    [
        ("lift.source == 'left'", "lift/*"),
        ("lift.source == 'r1/left'", "*/lift/*"),
        ("lift.source == 'a/b'", "lift/**"),
        ("lift.source == 'arm7'", "arm$*/joint"),
        ("lift.sources[1].source == 'left'", "lift/*"),
        ("lift.places.exists(lift, lift.source == 'lift/left')", "lift/*"),
        ("lift.sources.exists(l, l.places.exists(l, l.source == 'lift/left'))", "lift/*"),
        ("lift.base.source == 'lift/left'", "lift/*"),
    ],
)
def test_sources_that_may_be_are_not_reported(when, key):
    assert reported(when, key) == []
