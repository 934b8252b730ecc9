"""Timeline inputs -> the samples that the policy's streams would see."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import msgspec

from contextpolicy.errors import DecodeError
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.simulation.epoch import EPOCH
from contextpolicy.streams.decoding import MAX_DEPTH, Decoder, is_small
from contextpolicy.streams.timeline import RECORDED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.planning.conditions.sample import Sample
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream
    from contextpolicy.streams.timeline import TimedInput


@dataclass(frozen=True, slots=True)
class Skipped:
    """Inputs that became no sample: keys that no stream selects, keys without values, what the decoder refused."""

    unread: set[str] = field(default_factory=set)
    without_value: set[str] = field(default_factory=set)
    undecodable: Counter[str] = field(default_factory=Counter)
    """How often, by the decoder's message."""
    fed: set[str] = field(default_factory=set)
    """The streams that got anything at all."""
    mistyped: set[tuple[str, str]] = field(default_factory=set)
    """Streams of recorded messages of another type, each with the type that the recording has: nothing is decoded, as
    it might succeed, with values that mean nothing."""


def samples(
    policy: Policy,
    inputs: Iterable[TimedInput],
    skipped: Skipped,
    drops: Counter[tuple[str, str]],
    epoch: float = EPOCH,
) -> Iterator[tuple[float, Sample]]:
    """Each sample with its time in seconds from the start of the timeline; one per stream that selects the key."""
    epoch_ns = round(epoch * 1e9)
    readers: dict[tuple[str, str], list[_Reader]] = {}
    for timed in inputs:
        source = timed.encoding, timed.key
        selecting = readers.get(source)
        if selecting is None:
            streams = [stream for stream in policy.streams if selects(stream.key, timed.key)]
            selecting = readers[source] = [
                _Reader(stream, timed.encoding) for stream in streams if _has_type(stream, timed, skipped)
            ]
            skipped.unread.update(() if streams else (timed.key,))
        if not selecting:
            continue
        if timed.dataset is not None:
            skipped.without_value.add(timed.key)
        else:
            made = _made(timed, epoch_ns + round(timed.at * 1e9))
            for reader in selecting:
                skipped.fed.add(reader.stream.name)
                taken = reader.take(timed.value, made)
                if isinstance(taken, str):
                    skipped.undecodable[taken] += 1
                    drops[reader.stream.name, "undecodable"] += 1
                elif reader.stream.sources:
                    yield timed.at, taken._replace(key=timed.key)
                else:
                    yield timed.at, taken


class _Reader:
    """A stream that selects a key: gives the sample that its decoder would, mostly without making a payload.

    Writing and reading JSON took half of a run with a sensor of 1 kHz. ROS 2 messages are always decoded.
    """

    def __init__(self, stream: Stream, encoding: str) -> None:
        self.stream = stream
        # A JSON value is the decoded message, also where the robot's payload is CBOR or CDR.
        read = stream if encoding in (Encoding.CDR, RECORDED) else replace(stream, encoding=Encoding.JSON, type=None)
        self._decoder = Decoder(read)
        self._known: object = None
        self._plain = False

    def take(self, value: object, made: object) -> Sample | str:
        """The sample, or why the decoder refuses it.

        `made` is a payload, or `value` with a stamp. A repeated `value` is one object and is checked once.
        """
        if isinstance(made, bytes):
            return self._decode(made)
        if value is not self._known:
            self._known, self._plain = value, _is_plain(value)
        try:
            if self._plain:
                return self._decoder.sample(made)
        except DecodeError:
            pass  # `_decode` reports it in full
        try:
            return self._decode(json.dumps(made).encode())
        except RecursionError:
            return f"stream {self.stream.name}: the json payload nests deeper than {MAX_DEPTH} levels"

    def _decode(self, payload: bytes) -> Sample | str:
        try:
            return self._decoder.decode(payload)
        except DecodeError as error:
            return str(error)


def _has_type(stream: Stream, timed: TimedInput, skipped: Skipped) -> bool:
    """Whether a stream decodes what was recorded as what it was."""
    if stream.encoding is not Encoding.CDR or not timed.type or stream.type in (None, timed.type):
        return True
    skipped.fed.add(stream.name)
    skipped.mistyped.add((stream.name, timed.type))
    return False


def _is_plain(value: object) -> bool:
    """Whether decoders certainly accept a payload of this value: small enough, and without NaN and infinities."""
    try:
        payload = msgspec.json.encode(value)
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError):
        return False
    return is_small(payload) and b"null" not in payload  # it writes NaN and infinities as null


def _made(timed: TimedInput, now_ns: int) -> object:
    """The payload, or for JSON the decoded message."""
    if timed.payload is not None:
        return timed.payload
    return _stamped(timed.value, now_ns) if timed.message is None else timed.message.payload(now_ns)


def _stamped(value: object, now_ns: int) -> object:
    """As the player publishes it: an object without a `stamp` gets the current time, in ns."""
    return {"stamp": now_ns, **value} if isinstance(value, dict) else value
