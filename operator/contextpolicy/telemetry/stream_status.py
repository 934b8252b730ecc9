"""The streams in the status of a ContextPolicy: which are silent, what waits for them, what was dropped. Pure."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any

from contextpolicy.explain.deciding import waits
from contextpolicy.planning.conditions.absence import UNHEARD
from contextpolicy.telemetry.api_text import MAX_MESSAGE, timestamp

if TYPE_CHECKING:
    from collections.abc import Iterable

    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.planner import Planner

_UNITS = (("years", 365.25 * 86400), ("days", 86400.0), ("h", 3600.0), ("s", 0.0))


def stream_status(planner: Planner, ahead: float) -> list[dict[str, Any]]:
    """Each stream's health, what waits for it, and how many of its samples were dropped.

    The planner's time is `ahead` seconds of the wall clock, here as below.
    """
    waiting: dict[str, dict[str, str]] = defaultdict(dict)
    for who, waiting_for in waits(planner):
        sentence = f"{who} has been waiting since {timestamp(waiting_for.since - ahead)}: {waiting_for.reason}"
        waiting[waiting_for.stream].setdefault(who, sentence)
    return [_stream(planner, name, waiting[name].values(), ahead) for name in planner.streams]


def silences(planner: Planner, ahead: float) -> list[str]:
    """A sentence about each stream that is silent."""
    return [_silence(stream, ahead) for stream in planner.streams.values() if _is_silent(stream)]


def _stream(planner: Planner, name: str, waiting: Iterable[str], ahead: float) -> dict[str, Any]:
    stream = planner.streams[name]
    dropped = [f"{reason}: {count}" for (of, reason), count in sorted(planner.drops.items()) if of == name]
    health = [_silence(stream, ahead)] if _is_silent(stream) else []
    health += [] if stream.clock.behind is None else [_other_clock(stream.clock.behind)]
    message = "; ".join([*health, *waiting, *dropped])
    return {"name": name, "healthy": not _is_silent(stream), "message": message[:MAX_MESSAGE]}


def _silence(stream: StreamState, ahead: float) -> str:
    since = "no sample yet" if stream.seen_at is None else f"last sample at {timestamp(stream.seen_at - ahead)}"
    how = "is silent" if stream.silent else f"had no sample for {UNHEARD / 3600:g} h"
    return f"stream {stream.spec.name} ({stream.spec.key}) {how}: {since}"


def _is_silent(stream: StreamState) -> bool:
    return stream.silent or stream.unheard


def _other_clock(behind: float) -> str:
    unit, size = next((unit, size) for unit, size in _UNITS if abs(behind) >= size)
    off = f"{abs(behind) / (size or 1):.0f} {unit} {'behind' if behind > 0 else 'ahead of'} ours"
    return f"its timestamps are from another clock, {off} (simulated time, a replay?): the time of arrival counts"
