"""The test, the interval and the correction, by hand and against SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from timelines.experiments.paired import bootstrap, holm, sign_flip


def test_three_differences_have_eight_sign_patterns():
    assert sign_flip([1.0, 2.0, 3.0]) == 1 / 8  # only all of them positive reach 6
    assert sign_flip([-1.0, 2.0, 3.0]) == 2 / 8  # 6 and 4
    assert sign_flip([-1.0, -2.0, -3.0]) == 1


def test_ties_count_as_at_least_as_large():
    assert sign_flip([0.0, 0.0]) == 1
    assert sign_flip([0.1, 0.2, 0.3]) == 1 / 8  # 0.1 + 0.2 + 0.3 is not quite 0.6


def test_a_difference_that_does_not_exist_shows_nothing():
    assert sign_flip([math.nan] + [0.5] * 9) == 1


def test_ten_blocks_that_agree_are_enough_for_ten_goals():
    assert sign_flip([0.02] * 10) == 1 / 1024
    assert 10 * sign_flip([0.02] * 10) < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_it_is_scipys_permutation_test(seed):
    values = np.random.default_rng(seed).normal(0.3, 1, 9)
    theirs = stats.permutation_test(
        (values, np.zeros(9)),
        lambda x, y, axis: np.mean(x - y, axis=axis),
        permutation_type="samples",
        vectorized=True,
        alternative="greater",
        n_resamples=2**9,  # all of them: so many that none is drawn
    )
    assert sign_flip(values) == pytest.approx(theirs.pvalue)


@pytest.mark.parametrize("count", [0, 21])
def test_what_can_not_be_enumerated_is_refused(count):
    with pytest.raises(ValueError, match="differences"):
        sign_flip([1.0] * count)


def test_the_interval_is_scipys_percentile_bootstrap():
    values = np.random.default_rng(5).normal(1, 2, 10)
    found = bootstrap(values)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=7).confidence_interval
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=0.08)
    assert bootstrap(values) == found


def test_one_pair_has_no_width():
    assert bootstrap([0.5]) == (0.5, 0.5, 0.5, 1)


def test_holm_multiplies_by_what_is_left_and_never_falls():
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03}) == pytest.approx({"a": 0.03, "b": 0.06, "c": 0.06})
    assert holm({"a": 0.6, "b": 0.7}) == {"a": 1.0, "b": 1.0}
    assert holm({}) == {}
