"""What rmw_zenoh attaches to each ROS 2 sample: a sequence number, the publisher's time and its id.

Zenoh's own serialization of int64, int64 and 16 bytes, without names since 2025, with names before
(rmw_zenoh_cpp/src/detail/attachment_helpers.cpp).
"""

from __future__ import annotations

import struct

_GID = 16
_PLAIN = struct.Struct(f"<qqB{_GID}s")
_NAMED = struct.Struct(f"<16sq17sq11sB{_GID}s")
_NAMES = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")


def source_timestamp(attachment: bytes) -> float | None:
    """When the sample was published, in Unix seconds by the publisher's clock; None if it has another format."""
    if len(attachment) == _PLAIN.size:
        _, stamp, size, _ = _PLAIN.unpack(attachment)
        names = _NAMES
    elif len(attachment) == _NAMED.size:
        first, _, second, stamp, third, size, _ = _NAMED.unpack(attachment)
        names = (first, second, third)
    else:
        return None
    return stamp / 1e9 if names == _NAMES and size == _GID else None


def attach(sequence: int, stamp: int, gid: bytes) -> bytes:
    """An attachment as rmw_zenoh writes it; `stamp` in ns since 1970, `gid` of 16 bytes."""
    return _PLAIN.pack(sequence, stamp, _GID, gid)
