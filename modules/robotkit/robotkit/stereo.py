"""The stereo frame: both pictures of one instant in one message, so that they cannot be paired wrongly.

Layout, little-endian: "STR1", stamp of the exposure in ns (int64), sizes of both pictures in bytes (uint32 each), the
left picture, the right picture. Pictures are PNG or any other self-describing format.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from robotkit.errors import MessageError

_HEADER = struct.Struct("<4sqII")
_MAGIC = b"STR1"


@dataclass(frozen=True, slots=True)
class StereoFrame:
    """Two encoded pictures; in a replay, `stamp` is the recording's."""

    stamp: int
    left: bytes
    right: bytes


def encode(frame: StereoFrame) -> bytes:
    """Pack a frame into one payload."""
    return _HEADER.pack(_MAGIC, frame.stamp, len(frame.left), len(frame.right)) + frame.left + frame.right


def decode(payload: bytes) -> StereoFrame:
    """Unpack a payload, or raise MessageError."""
    if len(payload) < _HEADER.size or not payload.startswith(_MAGIC):
        raise MessageError(f"not a stereo frame: starts with {payload[:4]!r}")
    _, stamp, left, right = _HEADER.unpack_from(payload)
    if len(payload) != _HEADER.size + left + right:
        raise MessageError(
            f"stereo frame has {len(payload)} bytes: expected {_HEADER.size + left + right}, as its header says"
        )
    middle = _HEADER.size + left
    return StereoFrame(stamp, payload[_HEADER.size : middle], payload[middle:])
