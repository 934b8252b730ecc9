"""Sums of limits over time."""

import pytest

from tests.bench.reaction.overshoot import Overshoot, overshoot

BEFORE = {"slam": 0.1, "speech": 0.9}


def test_falls_before_rises_never_exceed():
    assert overshoot(1.0, BEFORE, [(5.0, "speech", 0.1), (5.1, "slam", 0.9)]) == Overshoot(0.0, 0.0, 0.0)


def test_a_rise_before_its_fall_exceeds_until_the_fall():
    found = overshoot(1.0, BEFORE, [(5.0, "slam", 0.9), (5.2, "speech", 0.1)])
    assert found == pytest.approx((0.8, 0.2, 0.16))


def test_overshoot_is_integrated_over_time():
    before = {"slam": 0.1, "arm": 0.1, "speech": 0.8}
    steps = [(5.0, "slam", 0.4), (5.1, "arm", 0.5), (5.4, "speech", 0.1)]
    assert overshoot(1.0, before, steps) == pytest.approx((0.7, 0.4, 0.1 * 0.3 + 0.3 * 0.7))
