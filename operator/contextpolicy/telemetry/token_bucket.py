"""How often something may be done: a few times at once, then at a steady rate. Pure."""

from __future__ import annotations

ROUNDING = 1e-6
"""Part of a token that does not matter: times are floats, and who waited as long as was asked must not wait again."""


class TokenBucket:
    """`burst` tokens, and one more every `refill` seconds. Times are seconds of one clock, which may step."""

    def __init__(self, burst: int, refill: float) -> None:
        self._burst, self._refill = burst, refill
        self._tokens, self._at = float(burst), 0.0

    def wait(self, now: float, reserve: int = 0) -> float:
        """Seconds until a token can be spent that leaves `reserve` others; 0 if that is now."""
        self._tokens = min(self._burst, self._tokens + max(0.0, now - self._at) / self._refill)
        self._at = now
        missing = reserve + 1 - self._tokens
        return missing * self._refill if missing > ROUNDING else 0.0

    def spend(self) -> None:
        """Take one token; see `wait`."""
        self._tokens -= 1
