"""When a timeline begins in virtual time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.errors import DecodeError
from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.decoding import seconds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.timeline import Timeline

EPOCH = 946_684_800
"""Unix seconds: 2000-01-01. Fixed, so that a run can be repeated; early, so that a context forced by hand until some
day of the policy's life is in force."""
_LATEST = 4_102_444_800
"""Unix seconds: 2100-01-01. Stamps after it, or before `EPOCH`, are not from a real clock."""


def epoch_of(policy: Policy, timeline: Timeline) -> float:
    """The timeline's begin in Unix seconds: `EPOCH`, unless the samples have a real clock's stamps.

    Then the first stamp is made the time of its own sample. With `EPOCH` all those samples would come from the future,
    and their stamps would be useless. A recording begins when it began.
    """
    if timeline.begin is not None:
        return round(timeline.begin, 6)
    first = min(_stamps(policy, timeline), default=None)
    return EPOCH if first is None else round(first[1] - first[0], 6)


def _stamps(policy: Policy, timeline: Timeline) -> Iterator[tuple[float, float]]:
    """Seconds in the timeline and Unix seconds of each stamp that a stream reads."""
    paths: dict[str, list[list[str]]] = {}
    streams = [(stream.key, stream.timestamp.split(".")) for stream in policy.streams if stream.timestamp]
    for entry in timeline.entries if streams else ():
        if entry.key not in paths:
            paths[entry.key] = [path for key, path in streams if selects(key, entry.key)]
        for path in paths[entry.key]:
            unix = _stamp(entry.value, path)
            if unix is not None and EPOCH <= unix - entry.start < _LATEST:
                yield entry.start, unix


def _stamp(value: Any, path: list[str]) -> float | None:
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    try:
        return None if value is None else seconds(value)
    except DecodeError:
        return None
