"""How much a task does for an input, so that its results are in time: 1 is all it can, less is less work, less exact.

Need decides, not the policy: quality falls when results come too late, and rises again while they are in time. A task
with a small share on an idle processor keeps its full quality. Where the processor is contested, the share is a hint
for how far to go at once. Pure: times come with the runs.

Nobody knows what a higher quality would cost, as part of the work is the same at any. So it is tried. A rise that makes
results late is taken back and tried again after twice as many results in time, so that quality does not oscillate.
"""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TYPE_CHECKING

from robotkit.profile import PLAUSIBLE_NS

if TYPE_CHECKING:
    from robotkit.profile import Run

LEAST = 0.1
LATE, AIM = 0.9, 0.7
"""Parts of the deadline. A result above `LATE` lowers quality to where the next one would take `AIM` if work were in
proportion to it; a rise goes to where the slowest of the last results would."""
STEP = 0.9
"""By how much quality falls at once where the share pays for more: what came late may have come late by chance."""
LEAST_RISE, LARGEST_RISE = 1.05, 2.0
"""Factors. Even above `AIM` a rise is tried: a task may take as long at any quality."""
PATIENCE, LONGEST_PATIENCE = 5, 320
"""Results in time, in a row, before quality rises: twice as many after each rise that failed."""
SOON = 10
"""A late result within so many times the patience after a rise says that it failed; if none comes, all is forgiven."""
BETTER = 1.5
"""A share that grows by this factor is a reason to try again at once."""
REMEMBERED = 20
"""The newest results, whose slowest says how far to rise, and whose shortest way from the source is what it takes."""


class Quality:
    """Follows the results of one task; `deadline` is in seconds, None leaves the quality alone."""

    def __init__(self, deadline: float | None, *, adaptive: bool = True) -> None:
        self.adaptive = adaptive and deadline is not None
        self.value = 1.0
        self._deadline = (deadline or 0.0) * 1e9
        self._hint, self._patience = 1.0, PATIENCE
        self._in_time = 0
        """Results since quality rose or one was late."""
        self._before: float | None = None
        """The quality before, if it rose."""
        self._took: deque[float] = deque(maxlen=REMEMBERED)
        self._ways: defaultdict[str, deque[int]] = defaultdict(lambda: deque(maxlen=REMEMBERED))

    def hint(self, share: float | None, cores: float | None) -> None:
        """Note what the policy says the task may have, and what it needs for full quality; None is all of it."""
        hint = 1.0 if share is None else min(share / (cores or 1.0), 1.0)
        if hint >= BETTER * self._hint:
            self._patience = PATIENCE
        self._hint = hint

    def done(self, run: Run, source: str = "") -> None:
        """Learn from a result: how old its input was when the task took it from this source, and how long that took."""
        if not self.adaptive:
            return
        took = max(run.finished - run.received + self._delay(run, source), 0) / self._deadline
        if took > LATE:
            self._fall(took)
        else:
            self._note(took)

    def _delay(self, run: Run, source: str) -> int:
        """How much longer a sample was on its way than others, in ns: its stamp may be of another clock."""
        way = run.received - run.stamp
        if abs(way) > PLAUSIBLE_NS:
            return 0
        self._ways[source].append(way)
        return way - min(self._ways[source])

    def _fall(self, took: float) -> None:
        if self._before is not None and self._in_time < SOON * self._patience:
            self._patience = min(2 * self._patience, LONGEST_PATIENCE)
            self.value = self._before
        else:
            if self._before is None and self._in_time > PATIENCE:  # it fell before, and that did not help
                self._patience = max(self._patience // 4, PATIENCE)
            bound = self._hint if self._hint < self.value else self.value * STEP
            self.value = max(self.value * AIM / took, bound, LEAST)
        self._changed(None)

    def _note(self, took: float) -> None:
        self._in_time += 1
        self._took.append(took)
        if self._in_time > SOON * self._patience:
            self._patience = PATIENCE
        if self._in_time >= self._patience and self.value < 1:
            factor = min(max(AIM / max(*self._took, 0.01), LEAST_RISE), LARGEST_RISE)
            before, self.value = self.value, min(self.value * factor, 1.0)
            self._changed(before)

    def _changed(self, before: float | None) -> None:
        self._before, self._in_time = before, 0
        self._took.clear()
