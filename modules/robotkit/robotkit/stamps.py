"""When a sample was published, by its attachment, and when what a ROS message says was true, by its header.

Our attachment is `{"stamp": ns since 1970, "crc32": of the payload}`; the checksum only where the payload may go by
shared memory. That of rmw_zenoh has two forms, Zenoh's own serialization of an int64, an int64 and 16 bytes: since
2025 without names, before with names (rmw_zenoh_cpp/src/detail/attachment_helpers.cpp). Both are read; we send the
newer one.
"""

from __future__ import annotations

import json
import struct
import zlib
from typing import TYPE_CHECKING, NamedTuple

from robotkit import json_text

if TYPE_CHECKING:
    import zenoh

_GID = 16
_RMW_ZENOH = struct.Struct(f"<qqB{_GID}s")
"""rmw_zenoh's attachment: sequence number, source timestamp in ns, length of the gid, gid."""
_NAMED = struct.Struct(f"<16sq17sq11sB{_GID}s")
_NAMES = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")
"""The names in the older form, each behind its length."""
_HEADER = {1: struct.Struct("<iI"), 0: struct.Struct(">iI")}
"""The stamp of a header, behind the 4 bytes that say how a message is encoded, by the second of them."""
_STAMPED = 12
"""Bytes to the end of that stamp."""
_END = 2**31 * 10**9
"""No stamp is of this time or later (2038), nor before 1970: ROS messages and MCAP files hold no other."""


class Attached(NamedTuple):
    """The fields of an attachment; None where one is missing."""

    stamp: int | None
    """When the sample was published, in ns since 1970."""
    crc32: int | None = None
    """The checksum of its payload."""

    def fits(self, payload: bytes) -> bool:
        """Whether this is the payload that was sent, as far as the attachment shows."""
        return self.crc32 is None or self.crc32 == zlib.crc32(payload)


NOTHING = Attached(None)


def attachment(stamp: int, shared: bytes | None = None) -> bytes:
    """Our own attachment; `stamp` is in ns since 1970. `shared` is a payload that may go by shared memory."""
    checksum = {} if shared is None else {"crc32": zlib.crc32(shared)}
    return json.dumps({"stamp": stamp, **checksum}).encode()


def ros_attachment(number: int, stamp: int, publisher: bytes) -> bytes:
    """What rmw_zenoh's subscriptions require: the publisher's message number, the stamp in ns, its 16-byte id."""
    return _RMW_ZENOH.pack(number, stamp, len(publisher), publisher)


def attached(sample: zenoh.Sample) -> Attached:
    """The fields of our own or rmw_zenoh's attachment; nothing when there is neither."""
    if sample.attachment is None:
        return NOTHING
    raw = sample.attachment.to_bytes()
    if (published := _by_rmw_zenoh(raw)) is not None:
        return Attached(_time(published))
    try:
        content = json_text.loads(raw)
        return Attached(_time(_whole(content["stamp"])), _whole(content.get("crc32")))
    except (ValueError, KeyError, TypeError, AttributeError):  # someone else's attachment
        return NOTHING


def header_stamp(message: bytes) -> int | None:
    """The stamp of a ROS message that begins with a header, in ns; None if it is too short or was never set."""
    if len(message) < _STAMPED:
        return None
    seconds, nanoseconds = _HEADER[message[1] & 1].unpack_from(message, 4)
    return int(seconds) * 10**9 + int(nanoseconds) or None


def _by_rmw_zenoh(raw: bytes) -> int | None:
    if len(raw) == _RMW_ZENOH.size:
        _, stamp, size, _ = _RMW_ZENOH.unpack(raw)
        names = _NAMES
    elif len(raw) == _NAMED.size:
        first, _, second, stamp, third, size, _ = _NAMED.unpack(raw)
        names = (first, second, third)
    else:
        return None
    return int(stamp) if names == _NAMES and size == _GID else None


def _time(stamp: int | None) -> int | None:
    return stamp if stamp is not None and 0 <= stamp < _END else None


def _whole(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None
