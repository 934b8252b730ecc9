"""How many Events one policy may post: enough for every problem, too few for a flapping context to flood the cluster.

Pure.
"""

from __future__ import annotations

from contextpolicy.telemetry.token_bucket import TokenBucket

BURST, REFILL = 25, 300.0
"""Events that may come at once, and seconds until one more may: what Kubernetes' own recorders allow an object. Each
costs two writes to flash, its end after an hour being one."""
FOR_PROBLEMS = 10
"""Events that contexts leave to problems."""


class EventBudget:
    """For one policy; times are seconds of one clock."""

    def __init__(self) -> None:
        self.left_out = 0
        self._bucket = TokenBucket(BURST, REFILL)

    def spend(self, now: float, *, routine: bool = False) -> bool:
        """Whether one more Event may be posted; counts those that may not. `routine` is what happens all the time."""
        if self._bucket.wait(now, FOR_PROBLEMS if routine else 0):
            self.left_out += 1
            return False
        self._bucket.spend()
        return True

    def admit_to(self, message: str) -> str:
        """The message, with how many Events were left out before it; the count restarts."""
        full = f"{message} ({self.left_out} earlier events were left out)" if self.left_out else message
        self.left_out = 0
        return full
