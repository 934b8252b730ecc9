"""What a stream's own timestamps say: whether a sample is in order, and how old it is, if its clock is ours at all.

A robot in simulation, or a recording that is played again, stamps its samples with another clock: hours or years off,
but steadily so. One late sample proves nothing, and a backlog that a network lets go catches up while it arrives; so
the offset must stay the same for some samples and some time. Then the time of arrival counts.
"""

from __future__ import annotations

import math

from contextpolicy.planning.timers import SAME_INSTANT
from contextpolicy.policy.spec import Clock

FUTURE_TOLERANCE = 1.0
"""Seconds that a sender's clock may be ahead; a timestamp beyond it is ignored, its sample still counts."""
REORDERING = 10.0
"""Seconds by which samples can overtake each other; a timestamp older than that means that its clock was set."""
STEADINESS = 0.01
"""How much an offset may change, as a part of itself, and still be that of one clock: a recording from yesterday can
be played at any speed, while a backlog of 20 s is no longer one after it shrank by 0.2 s."""
EVIDENCE = 5
"""Samples in a row that show another clock."""
EVIDENCE_TIME = 1.0
"""Seconds that they must take at least: the samples that a late listener is sent at once are no evidence."""

IGNORED, OUT_OF_ORDER, TOO_OLD = "timestamp ignored", "out of order", "too old"


class SourceClock:
    """The clock behind one stream; `behind` is by how many seconds it is behind ours, None as long as it is ours."""

    def __init__(self, choice: Clock, stale_after: float | None) -> None:
        self.behind: float | None = None
        self._choice, self._stale_after = choice, stale_after
        self._far = max(REORDERING, stale_after or 0.0)
        self._newest: float | None = None
        self._offset = self._late = 0.0
        self._elsewhere, self._set_back = _Run(), _Run()

    def judge(self, stamp: float | None, now: float) -> str | None:
        """What is wrong with a sample's timestamp: `IGNORED`, or a reason to drop the sample."""
        if stamp is None or self._choice is Clock.ARRIVAL:
            return None
        if not math.isfinite(stamp):
            return IGNORED
        offset = now - stamp
        if self._choice is Clock.AUTO:
            self._compare(offset, now)
        if self.behind is None and offset < -FUTURE_TOLERANCE:
            return IGNORED
        if self._is_overtaken(stamp, now):
            return OUT_OF_ORDER
        if self.behind is None and self._stale_after is not None and offset > self._stale_after:
            return TOO_OLD
        return None

    def forget_order(self) -> None:
        """The stream fell silent: whoever speaks next begins a new order."""
        self._newest = None

    def _compare(self, offset: float, now: float) -> None:
        """Decide whose clock it is: ours again at once, another's after some evidence."""
        if abs(offset) <= self._far:
            self.behind = None
            self._elsewhere.end()
        elif self.behind is not None:
            self.behind = offset
        else:
            if abs(offset - self._offset) > STEADINESS * abs(self._offset):
                self._elsewhere.end()
                self._offset = offset
            if self._elsewhere.goes_on(now):
                self.behind = offset

    def _is_overtaken(self, stamp: float, now: float) -> bool:
        """Whether a newer sample was there before; a clock that goes on from further back was set back."""
        if self._newest is not None and self._newest - REORDERING < stamp < self._newest - SAME_INSTANT:
            if stamp < self._late:
                self._set_back.end()
            self._late = stamp
            if not self._set_back.goes_on(now):
                return True
        self._set_back.end()
        self._newest = stamp
        return False


class _Run:
    """Samples in a row that show the same; it is evidence once they are enough and took long enough."""

    def __init__(self) -> None:
        self._count, self._since = 0, 0.0

    def goes_on(self, now: float) -> bool:
        """Count one more; whether that is evidence."""
        if not self._count:
            self._since = now
        self._count += 1
        return self._count >= EVIDENCE and now - self._since >= EVIDENCE_TIME

    def end(self) -> None:
        self._count = 0
