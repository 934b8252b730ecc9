"""Key expressions of rmw_zenoh against the stream's encoding and type.

rmw_zenoh publishes at DOMAIN/TOPIC/TYPE/HASH, the type as C++ mangles it (its design document, "Topic and service
name mapping"): 0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_7d9a00ff.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.stream_spec import Encoding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream

_TYPE = re.compile(r"(?:.*/)?(?P<package>\w+)::msg::dds_::(?P<name>\w+)_(?P<rest>/.*)?")


def ros_key_findings(policy: Policy) -> Iterator[Finding]:
    """Streams on rmw_zenoh's keys that can get no sample, or none that can be decoded."""
    for index, stream in enumerate(policy.streams):
        named = _TYPE.fullmatch(stream.key)
        if named is not None:
            type_name = f"{named['package']}/msg/{named['name']}"
            yield from _findings(f"spec.streams[{index}]", stream, type_name, named["rest"] or "")


def _findings(field: str, stream: Stream, type_name: str, rest: str) -> Iterator[Finding]:
    if not rest:
        allowed = f"{stream.key}/*: rmw_zenoh ends a key with the type's hash, so this one selects nothing"
        yield Finding(f"{field}.key", stream.key, allowed)
    if stream.encoding is not Encoding.CDR:
        allowed = f"cdr, with type {type_name}: the key is one of rmw_zenoh, which sends nothing else"
        yield Finding(f"{field}.encoding", str(stream.encoding), allowed)
    elif stream.type != type_name:
        yield Finding(f"{field}.type", stream.type, f"{type_name}, the type that the key names")
