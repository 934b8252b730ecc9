"""When a source published a sample, in the sample's attachment: `{"stamp": ns since 1970}`."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING

from robotkit import json_text

if TYPE_CHECKING:
    import zenoh

_RMW_ZENOH = struct.Struct("<qqB16s")
"""rmw_zenoh's attachment: sequence number, source timestamp in ns, length of the gid (16), gid."""


def attachment(stamp: int) -> bytes:
    """Our own attachment; `stamp` is in ns since 1970."""
    return json.dumps({"stamp": stamp}).encode()


def ros_attachment(number: int, stamp: int, publisher: bytes) -> bytes:
    """What rmw_zenoh's subscriptions require: the publisher's message number, the stamp in ns, its 16-byte id."""
    return _RMW_ZENOH.pack(number, stamp, len(publisher), publisher)


def stamp_of(sample: zenoh.Sample) -> int | None:
    """The stamp in our own or rmw_zenoh's attachment, in ns since 1970; None when there is neither."""
    if sample.attachment is None:
        return None
    raw = sample.attachment.to_bytes()
    if len(raw) == _RMW_ZENOH.size and raw[16] == 16:
        return int(_RMW_ZENOH.unpack(raw)[1])
    try:
        stamp = json_text.loads(raw)["stamp"]
    except (ValueError, KeyError, TypeError):  # someone else's attachment
        return None
    return stamp if isinstance(stamp, int) and not isinstance(stamp, bool) else None
