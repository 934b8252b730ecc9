"""How sure a comparison is: ratios of paired runs, with a confidence interval. Pure."""

from __future__ import annotations

import math
from statistics import mean, median, stdev
from typing import TYPE_CHECKING, NamedTuple

from scipy.stats import t as student

if TYPE_CHECKING:
    from collections.abc import Sequence

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A middle with its interval of 95 % confidence; a single pair has none (low and high are None)."""

    middle: float
    low: float | None
    high: float | None
    pairs: int

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return short(self.middle)
        return f"{short(self.middle)} [{short(self.low)}, {short(self.high)}]"

    def is_at_least(self, bound: float) -> bool | None:
        """Whether all of the interval is there; None while it holds the bound, or there is only one pair."""
        return self._is(self.low, self.high, bound, above=True)

    def is_at_most(self, bound: float) -> bool | None:
        """The same from above."""
        return self._is(self.low, self.high, bound, above=False)

    @staticmethod
    def _is(low: float | None, high: float | None, bound: float, *, above: bool) -> bool | None:
        if low is None or high is None or low < bound < high:
            return None
        return (low >= bound) if above else (high <= bound)


def of_ratios(ratios: Sequence[float]) -> Interval:
    """Geometric mean; a t interval on the logarithms, since 2 x and 0.5 x are equally far from 1 x."""
    logs = _interval([math.log(ratio) for ratio in ratios])
    low, high = (None if end is None else math.exp(end) for end in (logs.low, logs.high))
    return Interval(math.exp(logs.middle), low, high, logs.pairs)


def of_values(values: Sequence[float]) -> Interval:
    """Mean, with a t interval."""
    return _interval(values)


def _interval(values: Sequence[float]) -> Interval:
    middle = mean(values)
    if len(values) < 2:
        return Interval(middle, None, None, len(values))
    around = student.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * stdev(values) / math.sqrt(len(values))
    return Interval(middle, middle - float(around), middle + float(around), len(values))


def spread(values: Sequence[float]) -> str:
    """Median, with least and greatest in brackets if they differ."""
    middle, least, greatest = short(median(values)), short(min(values)), short(max(values))
    return middle if least == greatest else f"{middle} [{least}, {greatest}]"


def short(value: float) -> str:
    """Three digits, and never an exponent."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{float(f'{value:.3g}'):.3f}".rstrip("0").rstrip(".") or "0"
