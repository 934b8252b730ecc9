"""ROS 2 messages (CDR, as rmw_zenoh and the ros2dds bridge send them) -> nested maps, without a ROS installation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from contextpolicy.errors import DecodeError
from contextpolicy.policy.ros_types import is_known

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosbags.typesys.store import Typestore

    Convert = Callable[[Any], Any]


def reader(type_name: str, store: Typestore, *, max_values: int) -> Callable[[bytes], dict[str, Any]]:
    """A function from a payload, its 4-byte encapsulation header included, to the message's fields.

    Raises DecodeError for an unknown type; the function does for a broken payload. rosbags generates the type's code
    here, so that the first sample does not wait for it.
    """
    if not is_known(type_name, store):
        raise DecodeError(f"{type_name} is not a known ROS 2 message type")
    store.get_msgdef(type_name)
    convert = _message(store, type_name, max_values)

    def read(payload: bytes) -> dict[str, Any]:
        try:
            message = store.deserialize_cdr(payload, type_name)
        except SerdeError as error:
            raise DecodeError(f"is malformed: {error}") from error
        fields: dict[str, Any] = convert(message)
        return fields

    return read


def _message(store: Typestore, type_name: str, max_values: int) -> Convert:
    parts = [
        (name, normalize_fieldname(name), _field(store, description, max_values))
        for name, description in store.fielddefs[type_name][1]
    ]

    def convert(message: Any) -> dict[str, Any]:
        return {
            name: getattr(message, attribute) if part is None else part(getattr(message, attribute))
            for name, attribute, part in parts
        }

    return convert


def _field(store: Typestore, description: Any, max_values: int) -> Convert | None:
    """The conversion of a field to plain Python; None if it is plain already."""
    kind, detail = description
    if kind is Nodetype.BASE:
        return None
    if kind is Nodetype.NAME:
        return _message(store, detail, max_values)
    item_kind, item_detail = detail[0]
    if item_kind is Nodetype.NAME:
        return _items(_message(store, item_detail, max_values), max_values)
    return _items(None, max_values) if item_detail[0] == "string" else _numbers(max_values)


def _numbers(max_values: int) -> Convert:
    def convert(array: Any) -> list[Any]:
        _check_length(array, max_values)
        numbers: list[Any] = array.tolist()
        return numbers

    return convert


def _items(item: Convert | None, max_values: int) -> Convert:
    def convert(items: list[Any]) -> list[Any]:
        _check_length(items, max_values)
        return items if item is None else [item(part) for part in items]

    return convert


def _check_length(items: Any, max_values: int) -> None:
    if len(items) > max_values:
        raise DecodeError(
            f"holds a list of {len(items)} values: expected at most {max_values}; read a topic of readings instead"
        )
