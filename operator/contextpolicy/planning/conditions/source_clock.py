"""Judges samples by their own timestamps: their order, their age, and whether the sender's clock is ours at all.

A simulated robot or a replayed recording stamps its samples with another clock, hours or years off but by a constant
offset. One late sample proves nothing, and a backlog that the network releases catches up as it drains. So the offset
must stay constant over several samples and some time; from then on no sample is too old.
"""

from __future__ import annotations

import math

from contextpolicy.planning.conditions.timers import SAME_INSTANT
from contextpolicy.policy.stream_spec import Clock

FUTURE_TOLERANCE = 1.0
"""Seconds that a sender's clock may be ahead; a timestamp beyond it is ignored, its sample still counts."""
REORDERING = 10.0
"""Seconds by which samples can overtake each other; a timestamp further back means that the clock was set back."""
STEADINESS = 0.01
"""Relative change within which an offset counts as constant: yesterday's recording passes at any playback speed, a
backlog of 20 s fails once it has shrunk by 0.2 s."""
EVIDENCE = 5
"""Consecutive samples that it takes to believe in another clock."""
EVIDENCE_TIME = 1.0
"""Seconds that they must span: the burst of old samples that a late subscriber gets proves nothing."""

IGNORED, OUT_OF_ORDER, TOO_OLD = "timestamp ignored", "out of order", "too old"


class SourceClock:
    """The clock behind one stream; `behind` is how many seconds it lags ours, None while it is ours."""

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
        """The stream fell silent: the next source begins a new order."""
        self._newest = None

    def _compare(self, offset: float, now: float) -> None:
        """Decide whose clock it is: one sample is enough for ours, another's takes evidence."""
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
        """Whether a newer sample came first; a clock that keeps running from an earlier time was set back instead."""
        if self._newest is not None and self._newest - REORDERING < stamp < self._newest - SAME_INSTANT:
            # A clock that was set back moves forward again; stragglers that go further back are no evidence of it.
            if stamp < self._late:
                self._set_back.end()
            self._late = stamp
            if not self._set_back.goes_on(now):
                return True
        self._set_back.end()
        self._newest = stamp
        return False


class _Run:
    """Consecutive samples that agree: evidence after `EVIDENCE` samples that span `EVIDENCE_TIME`."""

    def __init__(self) -> None:
        self._count, self._since = 0, 0.0

    def goes_on(self, now: float) -> bool:
        """Count one more sample; returns whether the run is evidence now."""
        if not self._count:
            self._since = now
        self._count += 1
        return self._count >= EVIDENCE and now - self._since >= EVIDENCE_TIME

    def end(self) -> None:
        self._count = 0
