"""What streams keep of their last samples, in bounds: over all streams of all policies together.

A stream keeps its last sample, as it was decoded and as expressions see it, until another counts; which ones will count
is not known here. So a stream is charged for the largest that it ever let in, while its policy reads it. A sample that
would take more than there is is refused: to give up one that counts would change what contexts see.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.streams.decoding import MAX_PAYLOAD, MAX_VALUES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from contextpolicy.policy.stream_spec import Stream

POOL = 64 << 20
"""Bytes. A namespace may have its equal part of this whatever the others took, so that 2 take up to 1.5 times as much
together, 10 three times and 100 five times."""
DECODED, SEEN = 4, 1
"""Bytes that a byte of text takes as it was decoded, where one letter is rare, and as expressions see it."""
SMALLEST = 2
"""Bytes of a payload that a value takes at least."""
PER_VALUE = 80
"""Bytes that a value takes in all places, beside its text."""
LEAST = 256
"""Bytes: charges are powers of two from here, so that readings of varying length are charged once."""


class Charge(NamedTuple):
    """What a stream, as it was then, is charged for payloads of up to `largest` bytes; `amount` is in bytes too."""

    stream: Stream | None
    largest: int
    amount: int


NOTHING = Charge(None, 0, 0)


class Kept:
    """What the streams of one policy are charged for, by name; only `Retention` changes it."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.charges: dict[str, Charge] = {}


class Retention:
    """Everything on the loop's thread. `pool` is in bytes."""

    def __init__(self, pool: int) -> None:
        self._pool = pool
        self._policies: dict[str, Kept] = {}

    def begin(self, policy: str, namespace: str, streams: Iterable[str]) -> Kept:
        """Count what this policy's streams keep, from now on or further on after an edit."""
        kept = self._policies.setdefault(policy, Kept(namespace))
        for gone in kept.charges.keys() - set(streams):
            del kept.charges[gone]
        return kept

    def forget(self, policy: str) -> None:
        """The policy is gone, and with it what its streams kept."""
        self._policies.pop(policy, None)

    def admit(self, kept: Kept, stream: Stream, size: int) -> bool:
        """Whether a sample with a payload of that many bytes may be kept; on the hot path, so the usual case is first.

        A namespace that keeps less than its equal part is refused nothing because of what others keep.
        """
        before = kept.charges.get(stream.name, NOTHING)
        if size <= before.largest and stream is before.stream:
            return True
        # An edit may have changed what the stream keeps, and what it keeps of the time before stays until replaced.
        largest = max(LEAST, before.largest, 1 << (size - 1).bit_length())
        charge = Charge(stream, largest, footprint(stream, largest))
        if not self._has_room(kept.namespace, charge.amount - before.amount):
            return False
        kept.charges[stream.name] = charge
        return True

    def _has_room(self, namespace: str, more: int) -> bool:
        if more <= 0:
            return True
        own = [one for one in self._policies.values() if one.namespace == namespace]
        namespaces = len({one.namespace for one in self._policies.values()})
        return _sum(self._policies.values()) + more <= self._pool or _sum(own) + more <= self._pool // namespaces


def footprint(stream: Stream, size: int) -> int:
    """The bytes that a stream may keep of samples whose payloads have so many; its sources keep no more than one may.

    Over all sources, expressions see as many values as of the one sample of a stream without sources.
    """
    kept = min(size * max(1, stream.sources), MAX_PAYLOAD)
    held_back = DECODED if stream.debounce or stream.sample_every else 0
    return (DECODED + SEEN + held_back) * kept + PER_VALUE * min(kept // SMALLEST, MAX_VALUES)


def _sum(policies: Iterable[Kept]) -> int:
    return sum(charge.amount for one in policies for charge in one.charges.values())
