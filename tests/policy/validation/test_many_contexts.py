"""How often validation evaluates conditions: about as often per context of many as of few."""

from __future__ import annotations

import sys

import pytest

from contextpolicy.policy.validation import cases
from contextpolicy.policy.validation.latches import latches
from tests.planning.builders import a_context, a_policy, a_stream, a_task


def a_row(count, suspended, **fields):
    """Each context waits for its own task and suspends another."""
    names = [f"t{number}" for number in range(count)]
    contexts = [
        a_context(
            f"c{number}",
            " || ".join(f"s{number}.x{place} > 1" for place in range(4)),
            {suspended(number): {"suspend": True}},
            **fields,
        )
        for number in range(count)
    ]
    streams = [a_stream(f"s{number}", producedBy=name) for number, name in enumerate(names)]
    return a_policy(streams=[a_stream("imu"), *streams], tasks=[*map(a_task, [*names, "rest"])], contexts=contexts)


def a_chain(count):
    """The last one to be suspended is let go first: one context after the other proves to end."""
    return a_row(count, lambda number: f"t{number - 1}" if number else "rest")


def a_ring(count):
    """All keep each other."""
    return a_row(count, lambda number: f"t{(number + 1) % count}")


def an_ended_ring(count):
    """All of them could go on if it were not for `until`."""
    return a_row(count, lambda number: f"t{(number + 1) % count}", until="imu.x > 1")


def evaluations(policy):
    count = 0

    def profile(frame, event, _argument):
        nonlocal count
        count += event == "call" and frame.f_code is cases.holds.__code__

    sys.setprofile(profile)
    try:
        list(latches(policy))
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("made", [a_chain, a_ring, an_ended_ring])
def test_evaluations_grow_with_the_number_of_contexts_not_faster(made):
    few, many = evaluations(made(6)), evaluations(made(48))
    assert many <= 48 / 6 * few * 1.5
    assert many < 48 * 200
