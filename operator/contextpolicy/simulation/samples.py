"""Timeline inputs -> the samples that the policy's streams would see."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.errors import DecodeError
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.spec import Encoding
from contextpolicy.streams.decoding import Decoder

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Iterable, Iterator

    from contextpolicy.planning.sample import Sample
    from contextpolicy.policy.spec import Policy, Stream
    from contextpolicy.streams.timeline import TimedInput


EPOCH = 946_684_800
"""When timelines begin in virtual time, in Unix seconds: 2000-01-01. Fixed, so that a run can be repeated; early, so
that a context forced by hand until some day of the policy's life is in force."""
EPOCH_NS = EPOCH * 10**9


@dataclass(frozen=True, slots=True)
class Skipped:
    """Keys of inputs that no stream can read: because no stream selects them, or because they have no value."""

    unread: set[str] = field(default_factory=set)
    without_value: set[str] = field(default_factory=set)


def samples(
    policy: Policy, inputs: Iterable[TimedInput], skipped: Skipped, drops: Counter[tuple[str, str]]
) -> Iterator[tuple[float, Sample]]:
    """Each sample with its time in seconds from the start of the timeline; one per stream that selects the key."""
    readers: dict[str, list[tuple[Stream, Decoder]]] = {}
    for timed in inputs:
        if timed.key not in readers:
            readers[timed.key] = [(s, _decoder(s)) for s in policy.streams if selects(s.key, timed.key)]
        if not readers[timed.key]:
            skipped.unread.add(timed.key)
        elif timed.value is None:
            skipped.without_value.add(timed.key)
        else:
            payload = json.dumps(_stamped(timed.value, timed.at)).encode()
            for stream, decoder in readers[timed.key]:
                try:
                    yield timed.at, decoder.decode(payload)
                except DecodeError:
                    drops[stream.name, "undecodable"] += 1


def _stamped(value: object, at: float) -> object:
    """As the player publishes it: an object that has no `stamp` gets that of the moment."""
    return {"stamp": EPOCH_NS + round(at * 1e9), **value} if isinstance(value, dict) else value


def _decoder(stream: Stream) -> Decoder:
    """A timeline's value is the decoded message, so it is JSON also where the robot's payload is CBOR or CDR."""
    return Decoder(replace(stream, encoding=Encoding.JSON, type=None))
