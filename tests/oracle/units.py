"""How the reference model counts time, and how the resource writes durations and CPU.

An instant is twice the milliseconds since the start. What comes just after it is one more: an age of exactly 2 s is not
yet more than 2 s, just after that it is.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

SECOND = 2000
TICK = SECOND // 4
"""Samples come at ticks, and delays and windows take some, so that many things happen at one instant."""
HALF = TICK // 2
"""Ages end between the ticks. At a tick `age(imu) >= 1.0` would be true for a sample that comes just then, but not yet
for a context, which time turns after the sample."""
_UNITS = {"ms": SECOND // 1000, "s": SECOND, "m": 60 * SECOND}


@cache
def duration(text: str) -> int:
    """`1500ms` and `1.5s` alike."""
    unit = "ms" if text.endswith("ms") else text[-1]
    return int(Fraction(text.removesuffix(unit)) * _UNITS[unit])


def in_seconds(instant: int) -> float:
    return instant / SECOND


def millicores(quantity: str | int) -> int:
    """`300m` or a number of cores."""
    text = str(quantity)
    return int(text[:-1]) if text.endswith("m") else int(Fraction(text) * 1000)
