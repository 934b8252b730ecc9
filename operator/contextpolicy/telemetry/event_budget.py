"""How many Events one policy may post: enough for every trouble, too few for a flapping context to flood the cluster.

Pure.
"""

from __future__ import annotations

BURST = 25
"""Events that may come at once; what Kubernetes' own recorders allow an object."""
REFILL = 10.0
"""Seconds until one more may. Kubernetes' own wait 300 s, longer than what happens on a robot is of interest."""


class EventBudget:
    """A token bucket for one policy; times are seconds of one clock."""

    def __init__(self) -> None:
        self.left_out = 0
        self._tokens, self._at = float(BURST), 0.0

    def spend(self, now: float) -> bool:
        """Whether one more Event may be posted; counts those that may not."""
        self._tokens = min(BURST, self._tokens + max(0.0, now - self._at) / REFILL)
        self._at = now
        if self._tokens < 1:
            self.left_out += 1
            return False
        self._tokens -= 1
        return True

    def admit_to(self, message: str) -> str:
        """The message, with how many Events were left out before it; the count starts anew."""
        told = f"{message} ({self.left_out} earlier events were left out)" if self.left_out else message
        self.left_out = 0
        return told
