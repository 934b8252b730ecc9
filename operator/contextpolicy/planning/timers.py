"""Deadlines of many objects behind one `next due`: the planner sleeps until then and nothing polls."""

from __future__ import annotations

import heapq
from typing import Protocol


class Timed(Protocol):
    """Something that acts at a moment it chose."""

    def on_due(self, now: float) -> None:
        """Act; called once for each deadline set."""


class Timers:
    """A heap of deadlines, one per object.

    Moving a deadline later, what every sample does to its stream's, only notes the new time: the heap entry stays and
    is moved when it comes up. Objects due at one instant act in the order in which they first set a deadline.
    """

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._due: dict[int, float] = {}
        self._owners: list[Timed] = []
        self._numbers: dict[int, int] = {}

    def set(self, owner: Timed, due: float) -> None:
        """Let `owner` act at `due`; replaces its earlier deadline."""
        number = self._number(owner)
        earlier = self._due.get(number)
        self._due[number] = due
        if earlier is None or due < earlier:
            heapq.heappush(self._heap, (due, number))

    def clear(self, owner: Timed) -> None:
        """Forget the deadline of `owner`, if any."""
        self._due.pop(self._number(owner), None)

    def next_due(self) -> float | None:
        """The earliest deadline, None when nothing waits."""
        while self._heap:
            at, number = self._heap[0]
            due = self._due.get(number)
            if due == at:
                return at
            heapq.heappop(self._heap)
            if due is not None and due > at:
                heapq.heappush(self._heap, (due, number))
        return None

    def fire(self, now: float) -> None:
        """Let everything due by `now` act, in order of deadline; what they set anew and is due acts too."""
        while (due := self.next_due()) is not None and due <= now:
            _, number = heapq.heappop(self._heap)
            del self._due[number]
            self._owners[number].on_due(now)

    def _number(self, owner: Timed) -> int:
        number = self._numbers.get(id(owner))
        if number is None:
            number = self._numbers[id(owner)] = len(self._owners)
            self._owners.append(owner)
        return number
