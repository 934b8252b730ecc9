"""Means and intervals, against a t table and by hand."""

from __future__ import annotations

import math

import pytest

from timelines.experiments.intervals import Interval, of_ratios, of_values, short, spread


def test_the_interval_matches_students_t():
    found = of_values([1.0, 2.0, 3.0])
    assert (found.middle, found.pairs) == (2.0, 3)
    assert found.high is not None
    assert found.high - 2 == pytest.approx(4.303 / math.sqrt(3), abs=1e-3)  # t for 2 degrees of freedom, s = 1


def test_ratios_of_two_and_a_half_cancel():
    found = of_ratios([2.0, 0.5])
    assert found.middle == pytest.approx(1.0)
    assert found.low is not None
    assert found.high is not None
    assert found.low * found.high == pytest.approx(1.0)


def test_one_pair_has_no_interval():
    found = of_ratios([1.5])
    assert found.middle == pytest.approx(1.5)
    assert (found.low, found.high, found.pairs) == (None, None, 1)
    assert str(found) == "1.5"


@pytest.mark.parametrize(("bound", "at_least", "at_most"), [(0.9, True, False), (1.2, False, True), (1.05, None, None)])
def test_a_bound_inside_the_interval_is_inconclusive(bound, at_least, at_most):
    found = Interval(1.05, 1.0, 1.1, 3)
    assert (found.is_at_least(bound), found.is_at_most(bound)) == (at_least, at_most)


def test_equal_values_are_conclusive():
    assert of_values([2.0, 2.0]).is_at_least(2.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (0.00012, "0"), (1.426, "1.43"), (15.04, "15"), (12345.6, "12346"), (-0.5, "-0.5"), (100, "100")],
)
def test_figures_are_short(value, text):
    assert short(value) == text


def test_a_spread_is_shown_only_if_values_differ():
    assert (spread([2.0, 1.0, 4.0]), spread([3.0, 3.0])) == ("2 [1, 4]", "3")
