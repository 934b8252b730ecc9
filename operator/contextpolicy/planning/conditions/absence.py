"""Whether a stream without `staleAfter` had no sample for an hour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.conditions.timers import SAME_INSTANT

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.timers import Timers

UNHEARD = 3600.0
"""Seconds without a sample after which the status says so, even of a stream without `staleAfter`. Nothing else follows
from it: an emergency button may be silent for months."""


class AbsenceListener(Protocol):
    """Receives news of the watched stream."""

    seen_at: float | None
    """When its last sample came."""

    def on_unheard(self) -> None:
        """It had no sample for UNHEARD, or is heard again."""


class Absence:
    """A timer that samples do not move: when it is due, it looks when the last one came."""

    def __init__(self, listener: AbsenceListener, timers: Timers) -> None:
        self._listener, self._timers = listener, timers
        self.unheard = False

    def start(self, now: float) -> None:
        """Begin to wait for the next sample."""
        self._timers.set(self, now + UNHEARD)

    def end(self, now: float) -> None:
        """The stream that was unheard has a sample."""
        self.unheard = False
        self.start(now)
        self._listener.on_unheard()

    def adopt(self, old: Absence) -> None:
        """Wait as for the same stream of the policy's previous version."""
        self.unheard = old.unheard
        self._timers.adopt(old._timers, old, self)

    def on_due(self, now: float) -> None:
        """An hour may be over without a sample."""
        seen_at = self._listener.seen_at
        due = (now if seen_at is None else seen_at + UNHEARD) - SAME_INSTANT
        if now < due:
            self._timers.set(self, due)
        else:
            self.unheard = True
            self._listener.on_unheard()
