"""Exponential backoff: how long to wait before something is tried again. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pause:
    """The first and the longest pause, in seconds; each is twice the one before."""

    first: float
    longest: float

    def after(self, times: int) -> float:
        """The pause in seconds after this many times in a row; 0 before the first."""
        return min(self.longest, self.first * 2.0 ** min(times - 1, 20)) if times > 0 else 0.0


FAILED = Pause(0.1, 5.0)
"""After a patch without a usable answer: the API server is busy or briefly away."""
REFUSED = Pause(5.0, 120.0)
"""After a refusal. Its cause (a quota, a LimitRange, a role, an admission policy) may change without any change of the
pod, and without an event for us: so we never give up, but seldom ask."""
CONFLICTING = Pause(0.5, 5.0)
"""Before a foreign change of a container is reverted, from the second time on."""
OVERLOOKED = Pause(2.0, 120.0)
"""How long a kubelet may stay silent about a resize that it has seen; it looks at the runtime once a second."""
