"""Deadlines of many objects behind one `next due`: the planner sleeps until then and nothing polls."""

from __future__ import annotations

import heapq
import math
from typing import Protocol

SAME_INSTANT = 1e-6
"""Seconds: instants closer than this are one. Unix time in a float has steps of 0.24 us, and sums are rounded: a
sensor whose period equals a `hold` or `staleAfter` must not flap because of that."""


class Timed(Protocol):
    """Something that acts at a moment it chose."""

    def on_due(self, now: float) -> None:
        """Act; called once for each deadline set."""


class Timers:
    """A heap of deadlines, one per object.

    Every sample moves its stream's deadline, so moving one later, or clearing it, leaves the heap alone: the old entry
    is moved or dropped when it comes up. Objects due at one instant act in the order in which they first set a
    deadline, so that a replay acts in the same order.
    """

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Timed]] = []
        self._queued: dict[Timed, float] = {}
        self._due: dict[Timed, float] = {}
        self._numbers: dict[Timed, int] = {}

    def set(self, owner: Timed, due: float) -> None:
        """Let `owner` act at `due`; replaces its earlier deadline."""
        self._due[owner] = due
        queued = self._queued.get(owner)
        if queued is None or due < queued:
            self._push(owner, due)

    def clear(self, owner: Timed) -> None:
        """Forget the deadline of `owner`, if any."""
        self._due.pop(owner, None)

    def due(self, owner: Timed) -> float | None:
        """When `owner` acts next; None when it waits for nothing."""
        return self._due.get(owner)

    def adopt(self, old: Timers, former: Timed, owner: Timed) -> None:
        """Let `owner` act when `former` would have."""
        due = old.due(former)
        if due is None:
            self.clear(owner)
        else:
            self.set(owner, due)

    def next_due(self, by: float = math.inf) -> float | None:
        """The earliest deadline; None when nothing is due by then."""
        heap = self._heap
        while heap and heap[0][0] <= by:
            at, _, owner = heap[0]
            due = self._due.get(owner)
            if due == at:
                return at
            heapq.heappop(heap)
            if self._queued.get(owner) == at:
                del self._queued[owner]
                if due is not None:
                    self._push(owner, due)
        return None

    def fire(self, now: float) -> None:
        """Let everything due by `now` act, in order of deadline, including what they set meanwhile."""
        while self.next_due(now) is not None:
            owner = heapq.heappop(self._heap)[2]
            del self._due[owner], self._queued[owner]
            owner.on_due(now)

    def _push(self, owner: Timed, due: float) -> None:
        self._queued[owner] = due
        heapq.heappush(self._heap, (due, self._numbers.setdefault(owner, len(self._numbers)), owner))
        if len(self._heap) > 2 * len(self._numbers):
            self._tidy()

    def _tidy(self) -> None:
        """Drop replaced deadlines, which would otherwise stay until they are due, even in an hour."""
        self._heap[:] = [(at, self._numbers[owner], owner) for owner, at in self._queued.items()]
        heapq.heapify(self._heap)
