"""ROS 2 messages (CDR) in and out, without a ROS installation; needs the extra `robotkit[ros]`.

In: an input of encoding `cdr` with a `type`, as rmw_zenoh and zenoh-bridge-ros2dds send it. `decode` returns the
message, `readings` turns the common types into what modules work with.

Out: an output of encoding `cdr` with a `type`. A result maps the message's own fields, or is of a kind that
`ros_outputs` knows; missing fields are zero, a vector or quaternion may be a list, and the header is filled in.

`release` and `folder` say whose message definitions count, as an entry's `ros` and `types` in module.yaml.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from robotkit.errors import MessageError
from robotkit.ros_graph import dds_name
from robotkit.ros_types import HEADER, LATEST, hash_of, type_store

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


_HEADER_FIELD = ("header", (Nodetype.NAME, HEADER))


def decode(payload: bytes, type_name: str, *, release: str = LATEST, folder: str = "") -> Any:
    """A message as an object with the fields of its type; MessageError when the payload is broken."""
    try:
        return type_store(release, folder).deserialize_cdr(payload, type_name)
    except SerdeError as error:
        raise MessageError(f"not a {type_name} of ROS 2 {release}: {error}") from error
    except KeyError as error:
        raise MessageError(f"unknown message type {type_name}: ROS 2 {release} does not define it") from error


def encode(  # noqa: PLR0913 - what a header and a type consist of
    fields: Mapping[str, object],
    type_name: str,
    *,
    stamp: int,
    frame: str = "",
    release: str = LATEST,
    folder: str = "",
) -> bytes:
    """Serialize a message; TypeError for a field that the type does not have. `stamp` is in ns since 1970."""
    header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}
    store = type_store(release, folder)
    if _HEADER_FIELD in store.fielddefs[type_name][1]:
        fields = {"header": header, **fields}
    return bytes(store.serialize_cdr(_message(store, type_name, fields), type_name))


def topic_key(topic: str, type_name: str, *, domain: int = 0, release: str = LATEST, folder: str = "") -> str:
    """The key of a topic as rmw_zenoh writes it, such as `0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_...`."""
    return f"{domain}/{topic.strip('/')}/{dds_name(type_name)}/{hash_of(type_name, release, folder)}"


def is_known(type_name: str, *, release: str = LATEST, folder: str = "") -> bool:
    """Whether there is a message of this type."""
    return type_name in type_store(release, folder).fielddefs


def has_header(type_name: str, *, release: str = LATEST, folder: str = "") -> bool:
    """Whether messages of this type begin with a header."""
    fields = type_store(release, folder).fielddefs[type_name][1]
    return bool(fields) and fields[0] == _HEADER_FIELD


def stamp_of(message: Any) -> int | None:
    """The header's stamp in ns since 1970; None when there is no header or its stamp was never set."""
    header = getattr(message, "header", None)
    return header.stamp.sec * 10**9 + header.stamp.nanosec or None if header is not None else None


def _message(store: Typestore, type_name: str, value: object) -> Any:
    descriptions = store.fielddefs[type_name][1]
    names = [name for name, _ in descriptions]
    fields = value if isinstance(value, Mapping) else dict(zip(names, _sequence(value, type_name), strict=True))
    unknown = sorted(map(str, fields.keys() - names))
    if unknown:
        raise TypeError(f"{type_name} has no field {', '.join(unknown)}: expected {', '.join(names)}")
    values = {
        normalize_fieldname(name): _field(store, description, fields.get(name)) for name, description in descriptions
    }
    return store.types[type_name](**values)


def _sequence(value: object, type_name: str) -> Any:
    if isinstance(value, list | tuple | np.ndarray):
        return value
    raise TypeError(f"invalid value {value!r} for {type_name}: expected a mapping, or a list of its fields")


def _field(store: Typestore, description: Any, value: Any) -> Any:
    kind, detail = description
    if kind is Nodetype.BASE:
        return _base(detail[0], value)
    if kind is Nodetype.NAME:
        return _message(store, detail, {} if value is None else value)
    (item_kind, item_detail), length = detail
    if item_kind is Nodetype.BASE and item_detail[0] != "string":
        return _numbers(item_detail[0], value, length if kind is Nodetype.ARRAY else 0)
    items = ([None] * length if kind is Nodetype.ARRAY else []) if value is None else value
    return [_field(store, (item_kind, item_detail), item) for item in items]


def _base(name: str, value: Any) -> Any:
    kind = {"string": str, "wstring": str, "bool": bool}.get(name, float if name.startswith("float") else int)
    return kind() if value is None else kind(value)


def _numbers(name: str, value: Any, length: int) -> Any:
    kind = np.dtype({"bool": "?", "octet": "u1", "byte": "u1", "char": "u1"}.get(name, name))
    if value is None:
        return np.zeros(length, kind)
    if isinstance(value, bytes):
        return np.frombuffer(value, kind)
    return np.asarray(value, dtype=kind)
