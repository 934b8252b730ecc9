"""Queries from the bus, answered one at a time: a flood of them neither delays a plan nor fills the memory."""

from __future__ import annotations

import time
from collections import Counter, deque
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh
    from reactivex.abc import SchedulerBase

REST = 3.0
"""How many times as long as an answer took the loop has for everything else before the next one."""
MOST_WAITING = 32
"""Questions about one policy or one node that wait for the loop: who asks more often gets no answer."""
LARGEST_QUESTION = 4096
"""Bytes that a question may carry, in whatever place: they are never read, and while it waits they take memory."""
MOST_BYTES = 4 << 20
"""For which all questions that wait may count together: those of a viewer to 4,000 policies at once."""
PLACE = 1 << 10
"""Bytes for which each counts; what it carries besides, it counts as BUFFER."""
BUFFER = 64 << 10
"""Bytes that Zenoh receives at once, and may keep for the smallest part of them."""

_Waiting: TypeAlias = "tuple[str, zenoh.Query, Callable[[zenoh.Query], None], int]"
"""What a query is about, the query, what answers it, and for how many bytes it counts."""


class Questions:
    """All queries to one process. `clock` shows seconds and never steps."""

    def __init__(self, scheduler: SchedulerBase, clock: Callable[[], float] = time.monotonic) -> None:
        self._scheduler, self._clock = scheduler, clock
        self._lock, self._at_work = Lock(), False
        self._waiting: deque[_Waiting] = deque()
        self._about: Counter[str] = Counter()
        """How many of them wait, by what they are about."""
        self._weight = 0

    def ask(self, about: str, query: zenoh.Query, answer: Callable[[zenoh.Query], None]) -> None:
        """Have `answer` called on the loop when the query's turn comes, or end the query at once.

        Called on a Zenoh thread, which must not block. `about` is the policy or the node.
        """
        size = carried(query)
        weight = PLACE + (BUFFER if size else 0)
        with self._lock:
            full = self._about[about] >= MOST_WAITING or self._weight + weight > MOST_BYTES
            admitted = size <= LARGEST_QUESTION and not full
            begin = admitted and not self._at_work
            if admitted:
                self._at_work = True
                self._waiting.append((about, query, answer, weight))
                self._count(about, 1, weight)
        if begin:
            self._scheduler.schedule(self._answer)
        if not admitted:
            with query:  # that ends it
                pass

    def _answer(self, *_: object) -> None:
        began, (about, query, answer, weight) = self._clock(), self._waiting.popleft()
        try:
            with query:
                answer(query)
        finally:
            with self._lock:
                self._count(about, -1, -weight)
                self._at_work = more = bool(self._waiting)
            if more:
                self._scheduler.schedule_relative(REST * (self._clock() - began), self._answer)

    def _count(self, about: str, number: int, weight: int) -> None:
        self._weight += weight
        self._about[about] += number
        if not self._about[about]:
            del self._about[about]


def carried(query: zenoh.Query) -> int:
    """Bytes of what a query carries besides its key."""
    parts = [len(part) for part in (query.payload, query.attachment) if part is not None]
    return sum(parts) + len(str(query.parameters))
