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
        source = f"{timed.encoding} {timed.key}"
        if source not in readers:
            selecting = [stream for stream in policy.streams if selects(stream.key, timed.key)]
            readers[source] = [(stream, _decoder(stream, timed.encoding)) for stream in selecting]
        if not readers[source]:
            skipped.unread.add(timed.key)
        elif timed.value is None:
            skipped.without_value.add(timed.key)
        else:
            payload = _payload(timed)
            for stream, decoder in readers[source]:
                try:
                    yield timed.at, decoder.decode(payload)
                except DecodeError:
                    drops[stream.name, "undecodable"] += 1


def _payload(timed: TimedInput) -> bytes:
    if timed.message is not None:
        return timed.message.payload(EPOCH_NS + round(timed.at * 1e9))
    return json.dumps(_stamped(timed.value, timed.at)).encode()


def _stamped(value: object, at: float) -> object:
    """As the player publishes it: an object that has no `stamp` gets that of the moment."""
    return {"stamp": EPOCH_NS + round(at * 1e9), **value} if isinstance(value, dict) else value


def _decoder(stream: Stream, encoding: str) -> Decoder:
    """A JSON value is the decoded message, also where the robot's payload is CBOR or CDR; a ROS 2 message is itself."""
    return Decoder(stream if encoding == "cdr" else replace(stream, encoding=Encoding.JSON, type=None))
