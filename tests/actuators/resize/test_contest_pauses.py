"""How long we pause before we answer a writer who insists."""

from __future__ import annotations

import math

import pytest

from contextpolicy.actuators.resize.conflict import QUIET, REMEMBERED, STRIKES, YIELDED, Ownership
from contextpolicy.actuators.resize.pauses import CONFLICTING
from tests.actuators.resize.contesting import OTHERS, OURS, THEIRS
from tests.actuators.resize.rig import POLICY


def test_each_strike_of_an_insistent_writer_is_answered_later():
    governed, now, pauses = Ownership(POLICY, OURS), 0.0, []
    for _ in range(7):
        assert governed.compare(THEIRS, now)
        pauses.append(governed.until - now)
        now = governed.until
        assert governed.rests_until <= now
        governed.give(POLICY, OURS)
    assert pauses == [0, CONFLICTING.first, 1, 2, 4, CONFLICTING.longest, CONFLICTING.longest]


def strike_by_strike(every):
    """What is done about a writer who changes the limit `every` so many seconds, until we have yielded twice."""
    pauses: list[float] = []
    governed, now = Ownership(POLICY, OURS), 0.0
    while pauses.count(YIELDED) < 2:
        assert governed.compare(THEIRS, now)
        pauses.append(round(governed.until - now, 6))
        assert governed.forgotten_at == math.inf, "while it is in place it is not over"
        now = governed.until
        governed.give(POLICY, OURS)
        now += every
    return pauses


@pytest.mark.parametrize("every", [0.1, 60.0], ids=["all the time", "an autoscaler"])
def test_repeated_strikes_make_us_yield_and_retry_rarely(every):
    pauses = strike_by_strike(every)
    assert len(pauses) == STRIKES + 2
    assert all(pause <= CONFLICTING.longest for pause in pauses[:STRIKES])


def test_writer_that_stopped_starts_with_no_strikes():
    governed = Ownership(POLICY, OURS)
    for strike in range(STRIKES + 1):
        governed.compare(THEIRS, float(strike))
        governed.give(POLICY, OURS)
    assert governed.yielded
    tried_again = governed.until
    assert governed.forgotten_at == tried_again + REMEMBERED
    governed.compare(THEIRS, tried_again + REMEMBERED)
    assert not governed.yielded
    assert governed.rests_until == tried_again + REMEMBERED, "put back at once"


def test_changes_during_a_pause_count_as_one_strike():
    governed = Ownership(POLICY, OURS)
    governed.compare(THEIRS, 0.0)
    governed.give(POLICY, OURS)
    assert governed.compare(THEIRS, 0.1)
    until = governed.until
    assert not governed.compare(THEIRS, 0.2)
    assert not governed.compare(OTHERS, 0.3)
    assert (governed.rests_until, governed.seen) == (until, 0.3)


def test_quiet_period_resets_the_pause():
    governed = Ownership(POLICY, OURS)
    for now in (0.0, 1.0, 1.0 + QUIET + 0.1):
        governed.compare(THEIRS, now)
        pause = governed.until - now
        governed.give(POLICY, OURS)
    assert pause == 0


def test_unchanged_container_has_no_pause():
    assert Ownership(POLICY, OURS).rests_until == -math.inf
