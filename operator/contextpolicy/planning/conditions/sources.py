"""The sources behind one stream: distinguished by what its key's wildcards match; each keeps its latest sample."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.planning.conditions.source_clock import SourceClock
from contextpolicy.planning.conditions.timers import SAME_INSTANT
from contextpolicy.policy.cel_cost import size
from contextpolicy.policy.key_chunks import matched

if TYPE_CHECKING:
    from contextpolicy.policy.stream_spec import Stream

MOST_VALUES = 10_000
"""Numbers, texts and keys that expressions may see of one stream, as of the one sample of a stream without sources."""
SOURCE, SOURCES = "source", "sources"
"""The fields that a sample gets: which source it is from, and the latest sample of each."""
TOO_MANY, TOO_LARGE = "too many sources", "too large to keep sources apart"


class Sources:
    """The latest sample of each source, of a bounded number of them.

    One that is silent for `staleAfter` leaves and makes room. While all places are taken, samples of others are
    refused: to let one replace another would hide both.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream, self._most = stream, stream.sources
        self._kept: dict[str, KeptSource] = {}

    def name(self, key: str) -> str:
        """The source of a sample with this key."""
        return matched(self._stream.key, key)

    def clock(self, name: str) -> SourceClock:
        """The source's own clock: the samples of two robots are in no common order."""
        kept = self._kept.get(name)
        return SourceClock(self._stream.clock, self._stream.stale_after) if kept is None else kept.clock

    def hear(self, name: str, now: float) -> None:
        """The source sent a sample in time, used or not."""
        if name in self._kept:
            self._kept[name].heard_at = now

    def refusal(self, value: dict[str, Any]) -> str | None:
        """Why a sample can't be kept; None when it can."""
        if size(value) > MOST_VALUES // self._most:
            return TOO_LARGE
        return TOO_MANY if value[SOURCE] not in self._kept and len(self._kept) == self._most else None

    def keep(self, value: dict[str, Any], clock: SourceClock, now: float) -> KeptSource | None:
        """Take a sample as its source's latest; returns what the source had before."""
        name: str = value[SOURCE]
        before = self._kept.get(name)
        self._kept[name] = KeptSource(value, clock, now)
        return before

    def put_back(self, name: str, before: KeptSource | None) -> None:
        """Undo `keep`."""
        if before is None:
            del self._kept[name]
        else:
            self._kept[name] = before

    def samples(self) -> list[dict[str, Any]]:
        """The latest sample of each source, by name."""
        return [self._kept[name].value for name in sorted(self._kept)]

    def next_change(self) -> float | None:
        """When the next source leaves; None when none does."""
        stale_after = self._stream.stale_after
        if stale_after is None or not self._kept:
            return None
        return min([source.heard_at for source in self._kept.values()]) + stale_after

    def leave(self, now: float, *, speaking: str | None = None) -> bool:
        """Drop those that have been silent for too long, except the one `speaking`; returns whether there were any."""
        stale_after = self._stream.stale_after
        if stale_after is None:
            return False
        last = now + SAME_INSTANT - stale_after
        gone = [name for name, source in self._kept.items() if source.heard_at <= last and name != speaking]
        for name in gone:
            del self._kept[name]
        return bool(gone)

    def clear(self) -> None:
        """The whole stream fell silent."""
        self._kept.clear()


class KeptSource:
    """One of them, with its latest sample."""

    __slots__ = ("clock", "heard_at", "value")

    def __init__(self, value: dict[str, Any], clock: SourceClock, heard_at: float) -> None:
        self.value, self.clock, self.heard_at = value, clock, heard_at
