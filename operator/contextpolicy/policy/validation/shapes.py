"""What is known of a value before it arrives: its kind, and the fields of messages and examples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.cel_kinds import ValueKind
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.typesys.store import Typestore


PLAIN = "its example, a plain value,"
"""What declares the one field of a sample that is a number, a string or a list."""
MAX_FIELDS = 12
"""Fields that an error message lists."""
MAX_DEPTH = 32
"""Levels of an example that count: no payload may have more."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A kind in words; `fields` and `item` are None where nothing is known of them."""

    kind: str
    fields: Mapping[str, Shape] | None = None
    item: Shape | None = None
    owner: str = ""
    """What declares the fields, for error messages: a ROS type or an example."""
    complete: bool = True
    """Whether there are no other fields: true of a ROS type, false of an example, which is one sample of many."""


ANY = Shape(ValueKind.ANY)
BOOL = Shape(ValueKind.BOOL)
NUMBER = Shape(ValueKind.NUMBER)
TEXT = Shape(ValueKind.TEXT)
BYTES = Shape(ValueKind.BYTES)
NULL = Shape(ValueKind.NULL)
TIME = Shape(ValueKind.TIME)
DURATION = Shape(ValueKind.DURATION)
LIST = Shape(ValueKind.LIST)
MAP = Shape(ValueKind.MAP)

_SCALARS: dict[type, Shape] = {bool: BOOL, int: NUMBER, float: NUMBER, str: TEXT, bytes: BYTES}


_OF_KINDS = {
    **{shape.kind: shape for shape in (ANY, BOOL, NUMBER, TEXT, BYTES, NULL, TIME, DURATION, LIST, MAP)},
    **dict.fromkeys((ValueKind.WHOLE, ValueKind.DOUBLE), NUMBER),
    ValueKind.PATTERN: TEXT,
    ValueKind.STREAM: ANY,
}


def of_kind(kind: ValueKind) -> Shape:
    """What is known of an argument or a result of a function."""
    return _OF_KINDS[kind]


def list_of(item: Shape) -> Shape:
    """A list whose items all have this shape."""
    return Shape(LIST.kind, item=item)


def known_fields(shape: Shape, missed: str) -> str:
    """The fields that exist, in words, with a suggestion for the one that does not."""
    names = list(shape.fields or ())
    listed = ", ".join(names[:MAX_FIELDS]) + (", ..." if len(names) > MAX_FIELDS else "")
    return f"{shape.owner} has {listed}{did_you_mean(missed, names)}"


def of_message(store: Typestore, type_name: str) -> Shape:
    """The fields of a ROS 2 message, with those of the messages in it."""
    fields = {name: _of_field(store, description) for name, description in store.fielddefs[type_name][1]}
    return Shape(MAP.kind, fields, owner=type_name)


def _of_field(store: Typestore, description: Any) -> Shape:
    from rosbags.interfaces import Nodetype  # noqa: PLC0415 - loaded with the store

    kind, detail = description
    if kind is Nodetype.BASE:
        return {"bool": BOOL, "string": TEXT, "wstring": TEXT}.get(detail[0], NUMBER)
    return of_message(store, detail) if kind is Nodetype.NAME else list_of(_of_field(store, detail[0]))


def of_example(value: object, owner: str, depth: int = 0) -> Shape:
    """The shape of an example: every sample is assumed to look like it."""
    if depth > MAX_DEPTH:
        return ANY
    if isinstance(value, dict):
        fields = {str(name): of_example(inner, owner, depth + 1) for name, inner in value.items()}
        return Shape(MAP.kind, fields, owner=owner, complete=False)
    if isinstance(value, list):
        shapes = [of_example(item, owner, depth + 1) for item in value]
        return list_of(shapes[0] if shapes and all(shape == shapes[0] for shape in shapes) else ANY)
    return _SCALARS.get(type(value), ANY)
