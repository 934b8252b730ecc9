"""How many values a CBOR or MessagePack payload holds at most, without decoding it.

A payload of 1 MiB may hold a million empty maps: 64 MB of memory and a tenth of a second, only to be refused. In both
encodings all that is inside a list or map follows its header, so one walk over the headers finds every value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import DecodeError

if TYPE_CHECKING:
    from collections.abc import Callable

_SIZES = {
    # Numbers: bytes after the header's first.
    0xCA: 4,
    0xCB: 8,
    0xCC: 1,
    0xCD: 2,
    0xCE: 4,
    0xCF: 8,
    0xD0: 1,
    0xD1: 2,
    0xD2: 4,
    0xD3: 8,
    # Extensions of fixed size: a type and the content.
    0xD4: 2,
    0xD5: 3,
    0xD6: 5,
    0xD7: 9,
    0xD8: 17,
    # Lists and maps: the number of entries, which follow.
    0xDC: 2,
    0xDD: 4,
    0xDE: 2,
    0xDF: 4,
}
_LENGTHS = {0xC4: (1, 0), 0xC5: (2, 0), 0xC6: (4, 0), 0xC7: (1, 1), 0xC8: (2, 1), 0xC9: (4, 1)} | {
    0xD9: (1, 0),
    0xDA: (2, 0),
    0xDB: (4, 0),
}
"""Bytes, extensions and texts: bytes that hold the length, and bytes beside it."""

_TAGS = {2, 3, 55799}
"""CBOR tags of integers, and of CBOR itself. The decoder would make other things of other tags, only for them to be
refused: a fraction of two large integers takes it seconds."""


def msgpack_exceeds(payload: bytes, most: int) -> bool:
    """Whether a MessagePack payload holds more than `most` values, keys and containers included."""
    return _exceeds(payload, most, _after_msgpack)


def cbor_exceeds(payload: bytes, most: int) -> bool:
    """Whether a CBOR payload (RFC 8949) holds more than `most` values; keys, containers, tags and breaks included."""
    return _exceeds(payload, most, _after_cbor)


def refused_tag(tag: int) -> str:
    """Why a value of this CBOR tag is refused."""
    return f"holds a value of CBOR tag {tag}: expected numbers, strings, lists and maps"


def _exceeds(payload: bytes, most: int, after: Callable[[bytes, int], int]) -> bool:
    """A truncated payload ends the walk; the decoder reports it."""
    position, end = 0, len(payload)
    for _ in range(most):
        if position >= end:
            return False
        position = after(payload, position)
    return position < end


def _after_msgpack(payload: bytes, position: int) -> int:
    head = payload[position]
    if 0xA0 <= head <= 0xBF:
        return position + 1 + (head & 0x1F)
    found = _LENGTHS.get(head)
    if found is None:
        return position + 1 + _SIZES.get(head, 0)
    width, beside = found
    start = position + 1
    return start + width + beside + int.from_bytes(payload[start : start + width], "big")


def _after_cbor(payload: bytes, position: int) -> int:
    head = payload[position]
    kind, short = head >> 5, head & 0x1F
    start = position + 1
    width = 1 << (short - 24) if 24 <= short <= 27 else 0
    if kind == 6 and (tag := int.from_bytes(payload[start : start + width], "big") if width else short) not in _TAGS:
        raise DecodeError(refused_tag(tag))
    if kind not in (2, 3) or short > 27:  # of indefinite length: its parts follow
        return start + width
    length = int.from_bytes(payload[start : start + width], "big") if width else short
    return start + width + length
