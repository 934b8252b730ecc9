from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation.stamp_check import AHEAD_S, DISTRUST_S, StampCheck
from robotkit import MessageError

NOW = 1_795_362_405_000_000_000
MOST = 0.6


def at(seconds):
    return NOW + round(seconds * 1e9)


def age(check, stamp, received, now=0.0):
    """What it makes of a sample; times are in s from now on."""
    check.hear(at(stamp), at(received))
    return check.age(at(stamp), at(now), MOST)


def test_an_age_counts_from_publication_not_from_arrival():
    assert age(StampCheck("scan"), stamp=-0.5, received=-0.1) == pytest.approx(0.5)


def test_a_sample_that_waited_too_long_is_refused_with_its_age():
    with pytest.raises(MessageError, match=r"scan: published 5\.0 s ago, more than 0\.6 s: it was delayed"):
        age(StampCheck("scan"), stamp=-5, received=0)


def test_a_clock_that_is_hardly_ahead_is_believed():
    assert age(StampCheck("scan"), stamp=AHEAD_S, received=0) == 0


def test_a_clock_that_is_ahead_is_reported():
    with pytest.raises(MessageError, match=r"scan: its source's clock is 5\.0 s ahead .* synchronise the clocks"):
        age(StampCheck("scan"), stamp=5, received=0)


def test_an_old_sample_of_a_clock_ahead_is_not_taken_for_new():
    check = StampCheck("scan")
    check.hear(at(-5), at(-10))  # before this process froze for 10 s
    with pytest.raises(MessageError, match="ahead"):
        age(check, stamp=-0.1, received=0)


def test_a_clock_that_was_corrected_is_believed_again():
    check = StampCheck("scan")
    check.hear(at(-DISTRUST_S), at(-DISTRUST_S - 5))
    assert age(check, stamp=-0.1, received=0) == pytest.approx(0.1)


@given(st.floats(-10, 10), st.lists(st.floats(0, 5), min_size=1))
def test_late_samples_are_rejected_whatever_the_clock_after_a_prompt_one(offset, waits):
    """`offset` is how far the source's clock is ahead; its first sample arrives at once."""
    check = StampCheck("scan")
    check.hear(at(offset), at(0))
    for wait in waits:
        try:
            age(check, stamp=offset, received=wait, now=wait)
        except MessageError:
            continue
        assert wait <= MOST + AHEAD_S + 1e-6
