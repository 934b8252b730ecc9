"""How much a task does for an input, so that its results are in time: 1 is all it can, less is less work, less exact.

Need decides, not the policy: quality falls when results come too late, and rises again while there is time to spare. A
task with a small share on an idle processor keeps its full quality. Where the processor is contested, the share is a
hint for how far to go at once. Pure: times come with the runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotkit.profile import Run

LEAST = 0.1
LATE, AIM, EARLY = 0.9, 0.7, 0.55
"""Parts of the deadline: above `LATE` quality falls so that the next result should take `AIM`; it rises only while a
result at the next quality would take less than `AIM` and this one takes less than `EARLY`."""
RISE = 0.1
PATIENCE, LONGEST_PATIENCE = 5, 80
"""Results in a row that are early before quality rises; twice as many after each time that a rise made them late."""
STEP = 0.9
"""By how much quality falls at once where the share pays for more: what came late may have come late by chance."""


class Quality:
    """Follows the results of one task; `deadline` is in seconds, None leaves the quality alone."""

    def __init__(self, deadline: float | None, *, adaptive: bool = True) -> None:
        self.adaptive = adaptive and deadline is not None
        self.value = 1.0
        self._deadline = (deadline or 0.0) * 1e9
        self._hint = 1.0
        self._early, self._patience, self._risen = 0, PATIENCE, False

    def hint(self, share: float | None, cores: float | None) -> None:
        """Note what the policy says the task may have, and what it needs for full quality; None is all of it."""
        self._hint = 1.0 if share is None else min(share / (cores or 1.0), 1.0)

    def done(self, run: Run) -> None:
        """Learn from a result: how old its input was when the task took it, and how long that took."""
        if not self.adaptive:
            return
        took = run.latency / self._deadline
        if took > LATE:
            self._fall(took)
        elif took < EARLY:
            self._rise_after(took)
        else:
            self._early = 0

    def _fall(self, took: float) -> None:
        aimed = self.value * AIM / took
        bound = self._hint if self._hint < self.value else self.value * STEP
        self.value = max(aimed, bound, LEAST)
        if self._risen:
            self._patience = min(2 * self._patience, LONGEST_PATIENCE)
        self._early, self._risen = 0, False

    def _rise_after(self, took: float) -> None:
        self._early += 1
        higher = min(self.value + RISE, 1.0)
        if higher > self.value and self._early >= self._patience and took * higher / self.value < AIM:
            self.value, self._early, self._risen = higher, 0, True
