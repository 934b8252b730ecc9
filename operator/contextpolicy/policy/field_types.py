"""The types of the values' fields, and the fields that are read as their type says: such a field is stated once."""

from __future__ import annotations

import dataclasses
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from contextpolicy.policy.fields import LARGEST_WEIGHT

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import DataclassInstance

    from contextpolicy.policy.fields import Fields

    Value = TypeVar("Value", bound=DataclassInstance)

Cel: TypeAlias = str
"""A CEL expression."""
Cpu: TypeAlias = int
"""Thousandths of a core."""
Memory: TypeAlias = int
"""Bytes."""
Seconds: TypeAlias = float
Weighting: TypeAlias = float
"""A priority, score, weight or scale."""

_READERS: dict[str, Callable[[Fields, str], Any]] = {
    "Cel": lambda fields, name: fields.cel(name),
    "Cpu": lambda fields, name: fields.cpu(name),
    "Memory": lambda fields, name: fields.memory(name),
    "Seconds": lambda fields, name: fields.duration(name),
    "Weighting": lambda fields, name: fields.number(name, most=LARGEST_WEIGHT),
    "bool": lambda fields, name: fields.flag(name),
    "str": lambda fields, name: fields.optional_text(name),
}


def value_of(kind: type[Value], fields: Fields, **known: Any) -> Value:
    """A value of what is `known`, and of its other fields as their types say; one that is absent has its default."""
    others = (each for each in dataclasses.fields(kind) if each.name not in known)
    return kind(**known, **{each.name: _read(each, fields) for each in others})


def _read(field: dataclasses.Field[Any], fields: Fields) -> Any:
    first, *rest = field.name.split("_")
    name = first + "".join(word.capitalize() for word in rest)
    if isinstance(field.default, StrEnum):
        return fields.choice(name, field.default)
    value = _READERS[str(field.type).removesuffix(" | None")](fields, name)
    return field.default if value is None else value
