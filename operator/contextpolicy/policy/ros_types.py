"""The ROS 2 message types that streams may name, without a ROS installation."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.spec import Encoding

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from contextpolicy.policy.spec import Policy


@cache
def type_store() -> Typestore:
    """All standard message definitions. Loaded by the first stream that needs them: they take megabytes."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    return get_typestore(Stores.LATEST)


def is_known(type_name: str) -> bool:
    """Whether there is a standard message of this type."""
    return type_name in type_store().fielddefs


def type_findings(policy: Policy) -> list[Finding]:
    """The streams whose ROS type nobody here can decode; parsing can't tell, it knows no message definitions."""
    return [
        Finding(f"spec.streams[{index}].type", stream.type, f"{stream.type} is no standard ROS 2 message type")
        for index, stream in enumerate(policy.streams)
        if stream.encoding is Encoding.CDR and stream.type and not is_known(stream.type)
    ]
