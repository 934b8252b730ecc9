"""What has arrived and waits for the loop, in bounds: per stream, and for all streams of all policies together.

Beyond a bound the oldest goes: a newer reading is worth more. A stream loses only its own samples to its own bound, so
that a flood on one does not push out another's; beyond the bound of all, the stream that takes most loses first.
"""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

Item = TypeVar("Item")

PLACE = 2048
"""Bytes for which each sample counts besides its own: many small ones take time to decode rather than memory, and
this bounds how long the last one waits."""
PER_STREAM = 4 << 20
"""Bytes: four of the largest payloads, or 2,000 small ones, which is 0.2 s of samples at 10 kHz."""
TOTAL = 16 << 20
"""Bytes: with what decoding takes besides, the operator stays well within the chart's memory limit."""


class Lane(Generic[Item]):
    """What waits of one stream of one policy; only its `Backlog` changes it."""

    def __init__(self) -> None:
        self.waiting: deque[tuple[int, int, Item]] = deque()
        """Each with its place among all that has arrived, and for how many bytes it counts."""
        self.weight = 0
        self.overrun = 0
        """How many were dropped since this was last asked."""
        self.closed = False


class Backlog(Generic[Item]):
    """May be used by any thread. Both bounds are in bytes."""

    def __init__(self, per_stream: int, total: int) -> None:
        self._per_stream, self._total = per_stream, total
        self._lock = Lock()
        self._lanes: list[Lane[Item]] = []
        self._weight, self._arrived = 0, 0
        self.overran = False
        """Whether any lane had to drop anything yet: until then it need not be queried."""

    def lane(self) -> Lane[Item]:
        """A lane for one more stream."""
        lane = Lane[Item]()
        with self._lock:
            self._lanes.append(lane)
        return lane

    def close(self, lane: Lane[Item]) -> None:
        """Drop what waits in a lane; nothing more is put into it."""
        with self._lock:
            self._lanes.remove(lane)
            self._weight -= lane.weight
            lane.waiting.clear()
            lane.weight, lane.closed = 0, True

    def put(self, lane: Lane[Item], item: Item, size: int) -> None:
        """Append to a lane, and drop what is beyond the bounds; a closed lane takes nothing."""
        weight = PLACE + size
        with self._lock:
            if lane.closed:
                return
            self._arrived += 1
            lane.waiting.append((self._arrived, weight, item))
            lane.weight += weight
            self._weight += weight
            while lane.weight > self._per_stream:
                self._drop_oldest(lane)
            while self._weight > self._total:
                self._drop_oldest(max(self._lanes, key=_weight))

    def take(self, lanes: Sequence[Lane[Item]]) -> Item | None:
        """The one of these lanes that arrived first, None when nothing waits."""
        with self._lock:
            first = None
            for lane in lanes:
                if lane.waiting and (first is None or lane.waiting[0][0] < first.waiting[0][0]):
                    first = lane
            if first is None:
                return None
            _, weight, item = first.waiting.popleft()
            first.weight -= weight
            self._weight -= weight
            return item

    def overrun(self, lane: Lane[Item]) -> int:
        """How many a lane had to drop since this was last asked."""
        with self._lock:
            dropped, lane.overrun = lane.overrun, 0
            return dropped

    def _drop_oldest(self, lane: Lane[Item]) -> None:
        _, weight, _ = lane.waiting.popleft()
        lane.weight -= weight
        self._weight -= weight
        lane.overrun += 1
        self.overran = True


def _weight(lane: Lane[Item]) -> int:
    return lane.weight
