"""Comparing configurations block by block: an exact test, an interval, and a correction for many goals. Pure.

The block is the unit: what differs within it is the configuration, what differs between blocks is the day. A frame is
no unit, since neighbouring frames share their fate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Floats = Sequence[float] | NDArray[np.float64]

CONFIDENCE = 0.95
RESAMPLES = 10_000
MOST = 20
"""Pairs up to which all sign patterns are tried: a million."""
TIES = 1e-12
"""Sums that differ by less are equal but for rounding."""


class Interval(NamedTuple):
    """A mean with the bounds of its bootstrap interval; both are the mean where there is a single pair."""

    mean: float
    low: float
    high: float
    pairs: int


def sign_flip(differences: Floats) -> float:
    """How likely a mean this large or larger is if each difference were as likely to have the other sign (one-sided).

    Fisher's exact test for paired data (The Design of Experiments, 1935, section 21): all 2^n sign patterns.
    """
    values = np.asarray(differences, dtype=np.float64)
    if not 0 < len(values) <= MOST:
        raise ValueError(f"{len(values)} differences: expected 1 to {MOST}")
    if np.isnan(values).any():  # a comparison that does not exist shows nothing
        return 1.0
    sums = np.zeros(1)
    for value in np.abs(values):
        sums = np.concatenate([sums + value, sums - value])
    return float(np.mean(sums >= values.sum() - TIES))


def bootstrap(differences: Floats, seed: int = 1) -> Interval:
    """The mean, with the percentile interval of its bootstrap (Efron 1979): blocks are drawn with replacement."""
    values = np.asarray(differences, dtype=np.float64)
    mean = float(values.mean())
    if len(values) < 2:
        return Interval(mean, mean, mean, len(values))
    drawn = np.random.default_rng(seed).choice(values, (RESAMPLES, len(values)))
    tail = 100 * (1 - CONFIDENCE) / 2
    low, high = np.percentile(drawn.mean(axis=1), [tail, 100 - tail])
    return Interval(mean, float(low), float(high), len(values))


def holm(probabilities: Mapping[str, float]) -> dict[str, float]:
    """Each goal's probability as it counts among all of them (Holm 1979): at most as many errors as for one goal."""
    found: dict[str, float] = {}
    least = 0.0
    for place, (name, value) in enumerate(sorted(probabilities.items(), key=lambda pair: pair[1])):
        least = max(least, min(1.0, (len(probabilities) - place) * value))
        found[name] = least
    return {name: found[name] for name in probabilities}
