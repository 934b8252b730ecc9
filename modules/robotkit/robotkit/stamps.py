"""What a sample's attachment says of it: when its source published it, and for frames in shared memory a checksum.

`{"stamp": ns since 1970, "crc32": of the payload}`; the checksum only where the payload may go by shared memory.
"""

from __future__ import annotations

import json
import struct
import zlib
from typing import TYPE_CHECKING, NamedTuple

from robotkit import json_text

if TYPE_CHECKING:
    import zenoh

_RMW_ZENOH = struct.Struct("<qqB16s")
"""rmw_zenoh's attachment: sequence number, source timestamp in ns, length of the gid (16), gid."""


class Attached(NamedTuple):
    """What an attachment says; None where it doesn't."""

    stamp: int | None
    """When the sample was published, in ns since 1970."""
    crc32: int | None = None
    """The checksum of its payload."""

    def fits(self, payload: bytes) -> bool:
        """Whether this is the payload that was sent, as far as the attachment says."""
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
    """What our own or rmw_zenoh's attachment says; nothing when there is neither."""
    if sample.attachment is None:
        return NOTHING
    raw = sample.attachment.to_bytes()
    if len(raw) == _RMW_ZENOH.size and raw[16] == 16:
        return Attached(int(_RMW_ZENOH.unpack(raw)[1]))
    try:
        content = json_text.loads(raw)
        return Attached(_whole(content["stamp"]), _whole(content.get("crc32")))
    except (ValueError, KeyError, TypeError, AttributeError):  # someone else's attachment
        return NOTHING


def _whole(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None
