"""Numbers over a sliding window of one stream's samples."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.conditions.timers import SAME_INSTANT
from contextpolicy.policy.stream_spec import MAX_SAMPLES, FeatureOp

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.policy.stream_spec import Feature


class Window:
    """One feature's samples of the last `over` seconds; a sample leaves when it is exactly that old."""

    def __init__(self, feature: Feature, scope: Scope) -> None:
        self.feature = feature
        self._of = scope.compile(feature.of) if feature.of else None
        self._times: deque[float] = deque()
        self._numbers = _Queue(_OPERATIONS[feature.op])

    def read(self, scope: Scope) -> float:
        """The number that the sample in `scope` contributes; ExpressionError when `of` gives none.

        Infinity is a number here (a laser scanner's "nothing in range"), and so is NaN (a reading it does not have).
        """
        return self._of.reading(scope) if self._of else 1.0

    def add(self, number: float, now: float) -> None:
        """Add the newest sample's number; NaN counts for `count` and `rate`, and is left out of mean, min and max."""
        if math.isnan(number):
            if self.feature.op not in (FeatureOp.COUNT, FeatureOp.RATE):
                return
            number = 1.0
        if len(self._times) == MAX_SAMPLES:
            self._drop()
        self._times.append(now)
        self._numbers.push(number)

    def next_change(self) -> float | None:
        """When the oldest sample leaves the window; None when it is empty."""
        return self._times[0] + self.feature.over if self._times else None

    def value(self, now: float) -> float | None:
        """The feature at `now`; None when there is not a number for a mean, min or max."""
        while self._times and self._times[0] + self.feature.over <= now + SAME_INSTANT:
            self._drop()
        match self.feature.op:
            case FeatureOp.COUNT:
                return float(len(self._times))
            case FeatureOp.RATE:
                return len(self._times) / self.feature.over
            case FeatureOp.MEAN:
                total = self._numbers.total()
                return None if total is None or math.isnan(total) else total / len(self._times)
            case _:
                return self._numbers.total()

    def _drop(self) -> None:
        self._times.popleft()
        self._numbers.pop()


class Features:
    """The features of one stream, as they were when they were last measured."""

    def __init__(self, features: Sequence[Feature], scope: Scope) -> None:
        self._windows = [Window(feature, scope) for feature in features]
        self._measured: dict[str, float] = {}

    def read(self, scope: Scope) -> list[float]:
        """The numbers that the sample in `scope` contributes; ExpressionError when a window's `of` gives none.

        Read all before adding any: a sample that fails must not end up in some of the windows.
        """
        return [window.read(scope) for window in self._windows]

    def add(self, numbers: Iterable[float], now: float) -> None:
        """Add what was read of the newest sample."""
        for window, number in zip(self._windows, numbers, strict=True):
            window.add(number, now)

    def values(self, now: float) -> dict[str, float | None]:
        """Each feature as expressions see it at `now`."""
        return {window.feature.name: window.value(now) for window in self._windows}

    def measure(self, now: float) -> bool:
        """Bring them to `now`; returns whether that changed any."""
        before = self._measured
        self._measured = {name: value for name, value in self.values(now).items() if value is not None}
        return self._measured != before

    def next_change(self) -> float | None:
        """When the next sample leaves a window; None when all are empty."""
        return min([due for window in self._windows if (due := window.next_change()) is not None], default=None)

    def beside(self, value: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
        """A sample's fields with the features, and the names of the features that have no value.

        A sample's own field must not stand in for a feature of the same name that has no value.
        """
        names = [window.feature.name for window in self._windows]
        lacking = [name for name in names if name not in self._measured]
        fields = {**value, **self._measured}
        for name in lacking:
            fields.pop(name, None)
        return fields, lacking


def _add(first: float, second: float) -> float:
    return first + second


_OPERATIONS: dict[FeatureOp, Callable[[float, float], float]] = {
    FeatureOp.MEAN: _add,
    FeatureOp.MIN: min,
    FeatureOp.MAX: max,
    FeatureOp.RATE: _add,
    FeatureOp.COUNT: _add,
}


class _Queue:
    """A queue that keeps the total of its numbers in amortised constant time, whatever the window's length.

    Two stacks with running totals. Nothing is ever subtracted, so no rounding error stays behind when a number leaves,
    and minimum and maximum work the same way.
    """

    def __init__(self, combine: Callable[[float, float], float]) -> None:
        self._combine = combine
        self._out: list[float] = []
        self._in: list[float] = []
        self._in_total: float | None = None

    def push(self, number: float) -> None:
        self._in.append(number)
        self._in_total = number if self._in_total is None else self._combine(self._in_total, number)

    def pop(self) -> None:
        """Forget the oldest number."""
        if not self._out:
            self._turn()
        self._out.pop()

    def total(self) -> float | None:
        if not self._out or self._in_total is None:
            return self._out[-1] if self._out else self._in_total
        return self._combine(self._out[-1], self._in_total)

    def _turn(self) -> None:
        """Turn the newer stack over: the oldest number ends up on top, with the total of all."""
        for number in reversed(self._in):
            self._out.append(number if not self._out else self._combine(number, self._out[-1]))
        self._in.clear()
        self._in_total = None
