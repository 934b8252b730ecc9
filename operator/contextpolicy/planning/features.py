"""Numbers over a sliding window of one stream's samples."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from contextpolicy.planning.expressions import Expression
from contextpolicy.planning.policy import FeatureOp

if TYPE_CHECKING:
    from contextpolicy.planning.expressions import Scope
    from contextpolicy.planning.policy import Feature

MAX_SAMPLES = 10_000
"""A window keeps at most this many samples, the newest ones: 10 s of a 1 kHz sensor."""


class Window:
    """One feature's samples of the last `over` seconds, the newest included, the one exactly `over` old not."""

    def __init__(self, feature: Feature) -> None:
        self.feature = feature
        self._of = Expression(feature.of) if feature.of else None
        self._samples: deque[tuple[float, float]] = deque(maxlen=MAX_SAMPLES)

    def add(self, scope: Scope, now: float) -> None:
        """Take the sample that `scope` holds; ExpressionError when `of` has no number on it."""
        self._samples.append((now, self._of.number(scope) if self._of else 1.0))

    def value(self, now: float) -> float | None:
        """The feature at `now`; None when mean, min or max have no sample to tell about."""
        while self._samples and self._samples[0][0] <= now - self.feature.over:
            self._samples.popleft()
        values = [value for _, value in self._samples]
        match self.feature.op:
            case FeatureOp.COUNT:
                return float(len(values))
            case FeatureOp.RATE:
                return len(values) / self.feature.over
            case FeatureOp.MEAN:
                return sum(values) / len(values) if values else None
            case FeatureOp.MIN:
                return min(values, default=None)
            case FeatureOp.MAX:
                return max(values, default=None)
