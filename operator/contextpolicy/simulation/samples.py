"""Timeline inputs -> the samples that the policy's streams would see."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.errors import DecodeError
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.spec import Encoding
from contextpolicy.simulation.epoch import EPOCH
from contextpolicy.streams.decoding import MAX_DEPTH, Decoder, is_small

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.planning.sample import Sample
    from contextpolicy.policy.spec import Policy, Stream
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


def samples(
    policy: Policy,
    inputs: Iterable[TimedInput],
    skipped: Skipped,
    drops: Counter[tuple[str, str]],
    epoch: float = EPOCH,
) -> Iterator[tuple[float, Sample]]:
    """Each sample with its time in seconds from the start of the timeline; one per stream that selects the key."""
    epoch_ns = round(epoch * 1e9)
    readers: dict[str, list[_Reader]] = {}
    for timed in inputs:
        selecting = readers.get(timed.key)
        if selecting is None:
            selecting = readers[timed.key] = [_Reader(s) for s in policy.streams if selects(s.key, timed.key)]
        if not selecting:
            skipped.unread.add(timed.key)
        elif timed.value is None:
            skipped.without_value.add(timed.key)
        else:
            value = _stamped(timed.value, epoch_ns + round(timed.at * 1e9))
            for reader in selecting:
                skipped.fed.add(reader.stream.name)
                taken = reader.take(timed.value, value)
                if isinstance(taken, str):
                    skipped.undecodable[taken] += 1
                    drops[reader.stream.name, "undecodable"] += 1
                else:
                    yield timed.at, taken


class _Reader:
    """A stream that selects a key: what its decoder would make of a value's payload, mostly without the payload.

    Writing and reading JSON took half of a run with a sensor of 1 kHz.
    """

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        # A timeline's value is the decoded message, so it is JSON also where the robot's payload is CBOR or CDR.
        self._decoder = Decoder(replace(stream, encoding=Encoding.JSON, type=None))
        self._known: object = None
        self._plain = False

    def take(self, value: object, stamped: object) -> Sample | str:
        """The sample, or why the decoder refuses it; `value`, without the stamp, is one object while it repeats."""
        if value is not self._known:
            self._known, self._plain = value, _is_plain(value)
        try:
            if self._plain:
                return self._decoder.sample(stamped)
        except DecodeError:
            pass  # `decode` says it in full
        try:
            return self._decoder.decode(json.dumps(stamped).encode())
        except DecodeError as error:
            return str(error)
        except RecursionError:
            return f"stream {self.stream.name}: the json payload nests deeper than {MAX_DEPTH} levels"


def _is_plain(value: object) -> bool:
    """Whether a payload with this value is certainly none that decoders refuse: too large, or no JSON number in it."""
    try:
        payload = json.dumps(value).encode()
    except RecursionError:
        return False
    return is_small(payload) and not any(word in payload for word in (b"NaN", b"Infinity"))


def _stamped(value: object, now_ns: int) -> object:
    """As the player publishes it: an object that has no `stamp` gets that of the moment."""
    return {"stamp": now_ns, **value} if isinstance(value, dict) else value
