"""Which numbers are tried in place of each NaN of a condition: one that holds with all of them holds. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.cel_cost import BUDGET

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

MAX_TRIALS = 256
"""Evaluations of one condition with numbers in place of several NaNs, some 2 ms; less where it does not hold."""
MAX_TRIED = BUDGET // 4
"""Values that all these evaluations may read together, some 40 ms. Where that is too few to try each number once, it is
four times as many; beyond that the condition fails."""


def trials(numbers: Sequence[float], unknown: int, most: int = MAX_TRIALS) -> Iterator[Iterator[float]]:
    """Numbers to try for so many unknown ones: one for all of them, then different ones.

    Two unknown numbers get each pair, as long as that is at most `most`. Of more each two get many pairs: to try
    all combinations would take too long.
    """
    count = len(numbers)
    apart = 0 if unknown < 2 else count - 1
    for step in range(0, apart + 1, max(1, count * count // most)):
        for first in range(count):
            yield (numbers[(first + place * step) % count] for place in range(unknown))


def nans(value: object) -> int:
    """How many NaNs it holds."""
    match value:
        case float():
            return math.isnan(value)
        case dict():
            return sum(map(nans, value.values()))
        case list():
            return sum(map(nans, value))
    return 0


def without_nan(value: Any, numbers: Iterator[float]) -> Any:
    """The value with the next of the numbers in place of each NaN."""
    match value:
        case float():
            return next(numbers) if math.isnan(value) else value
        case dict():
            return {name: without_nan(inner, numbers) for name, inner in value.items()}
        case list():
            return [without_nan(inner, numbers) for inner in value]
    return value
