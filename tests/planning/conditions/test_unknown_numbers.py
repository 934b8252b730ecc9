"""Numbers that are not finite, or too large, in conditions."""

from __future__ import annotations

import math
import time
from itertools import islice
from types import SimpleNamespace

import pytest

from contextpolicy.planning.conditions.expressions import Guarded
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.conditions.unknown_numbers import MAX_TRIALS, trials


def noting(reported: list[str]) -> SimpleNamespace:
    """A listener that appends each error and each recovery."""
    return SimpleNamespace(
        on_expression_error=lambda _, reason: reported.append(reason), on_expression_recovery=reported.append
    )


@pytest.mark.parametrize(
    ("source", "truth"),
    [
        ("scan.near < 1.0", False),
        ("scan.near > 1.0", False),
        ("abs(scan.near) >= 0.0", True),
        ("!(scan.near < 1.0)", False),
        ("scan.near < 1.0 || scan.far > 1.0", True),
        ("scan.ranges.exists(r, r < 1.0)", True),
        ("scan.ranges.all(r, r > 0.1)", False),
        ("scan.near < -0.5 || scan.near > 0.5", False),
        ("scan.near < 5.0 || scan.near > 6.0", False),
        ("abs(scan.near) > 0.5", False),
        ("norm([scan.near, 0.0]) > 0.1", False),
        ("norm([scan.near, 3.0]) > 2.0", True),
        ("sqrt(scan.near) > 1.0", False),
        ("min(scan.ranges) < 0.6", True),
        ("min(0.5, scan.near) > 0.3", False),
        ("max([3.0, scan.near]) < 4.0", False),
        ("scan.far > 100.0 && !(scan.far < 100.0)", True),
        ("-scan.far < 0.0 && max(scan.far, 1.0) > 1.0", True),
    ],
)
def test_nan_and_infinity_compare_without_an_error(source, truth):
    reported: list[str] = []
    scope = Scope()
    guarded, unknown = Guarded(scope.compile(source), scope, noting(reported)), scope.compile("scan.near != scan.near")
    scope.bind("scan", {"near": math.nan, "far": math.inf, "ranges": [math.nan, math.inf, 0.5]})
    assert (guarded.truth(0.0), reported) == (truth, [])
    assert unknown.truth(scope), "the sample itself is as it was"


@pytest.mark.parametrize(
    ("source", "truth"),
    [
        ("scan.left == scan.right", False),
        ("scan.left != scan.right", True),
        ("scan.left <= scan.right", False),
        ("scan.left == scan.left", False),
        ("scan.left < 3.0 || scan.right >= 3.0", False),
        ("scan.left < 10.0 || scan.right > 3.0", False),
        ("scan.left < 3.0 || scan.left >= 3.0", True),
        ("scan.left < 3.0 || scan.left >= 3.0 || scan.right > 1.0", True),
        ("imu.x == scan.left", False),
        ("scan.ranges[0] == scan.ranges[1]", False),
        ("scan.ranges.exists(r, r < 1.0) && scan.ranges[0] <= scan.ranges[1]", False),
        ("scan.ranges.exists(r, r < 1.0)", True),
        ("abs(scan.left) + abs(scan.right) >= 0.0", True),
    ],
)
def test_each_nan_is_unknown_independently(source, truth):
    reported: list[str] = []
    scope = Scope()
    guarded = Guarded(scope.compile(source), scope, noting(reported))
    scope.bind("scan", {"left": math.nan, "right": math.nan, "ranges": [math.nan, math.nan, 0.5]})
    scope.bind("imu", {"x": math.nan})
    assert (guarded.truth(0.0), reported) == (truth, [])


@pytest.mark.parametrize("numerals", [1, 2, 3, 16])
@pytest.mark.parametrize("unknown", [1, 2, 1000])
def test_how_often_unknown_numbers_are_tried_is_bounded(numerals, unknown):
    numbers = [float(number) for number in range(4 * numerals + 3)]
    tried = [tuple(islice(trial, 2)) for trial in trials(numbers, unknown)]
    assert len(tried) <= MAX_TRIALS + len(numbers)
    assert {one[0] for one in tried} == set(numbers)
    if unknown == 2 and numerals <= 3:
        assert set(tried) == {(first, second) for first in numbers for second in numbers}


THRESHOLDS = " || ".join(["r <= 1.0", "r > 1.0", *(f"r == 1.{digit}" for digit in range(1, 10))])


@pytest.mark.parametrize(
    "source", ["scan.ranges.all(r, r <= r)", "scan.ranges.exists(r, r < 0.5)", f"scan.ranges.all(r, {THRESHOLDS})"]
)
@pytest.mark.parametrize("count", [720, 10_000, 20_000])
def test_conditions_on_many_unknown_numbers_have_bounded_cost(source, count):
    """The worst found is some 0.2 s of CPU; unbounded, it is 7 s."""
    reported: list[str] = []
    scope = Scope()
    guarded = Guarded(scope.compile(source), scope, noting(reported))
    scope.bind("scan", {"ranges": [math.nan] * (count - 1) + [0.1]})
    begin = time.thread_time()
    truth = guarded.truth(0.0)
    assert time.thread_time() - begin < 1.0
    assert truth is not bool(reported)


def test_numbers_that_are_too_many_to_be_tried_are_reported():
    reported: list[str] = []
    scope = Scope()
    guarded = Guarded(scope.compile(f"scan.ranges.all(r, {THRESHOLDS})"), scope, noting(reported))
    scope.bind("scan", {"ranges": [math.nan] * 5000})
    assert not guarded.truth(0.0)
    assert reported == ["reads a NaN among 5002 values: expected at most 1524, given the numbers it compares them with"]


def test_a_real_error_is_reported_despite_nan():
    reported: list[str] = []
    scope = Scope()
    guarded = Guarded(scope.compile("scan.nearest < 1.0"), scope, noting(reported))
    scope.bind("scan", {"near": math.nan})
    assert not guarded.truth(0.0)
    assert reported == ["the sample has no field 'nearest'"]
