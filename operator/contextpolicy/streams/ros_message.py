"""ROS 2 messages written as JSON -> CDR payloads, so that a timeline can stand in for a ROS 2 robot.

Omitted fields are 0, empty or false, as in ROS. JSON has no NaN and no infinities (a laser scanner's "nothing in
range"): a float field accepts the texts "NaN", "Infinity" and "-Infinity", as the JSON form of protobuf does.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname

from contextpolicy.errors import Fault, Finding

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosbags.typesys.store import Typestore

HEADER = "std_msgs/msg/Header"
TIME = "builtin_interfaces/msg/Time"
_NOT_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


class RosMessage:
    """One message; each header without a stamp gets the time of publication.

    `findings` lists what in the value does not fit the type, by path; call `payload` only if there are none.
    """

    def __init__(self, type_name: str, store: Typestore, value: object) -> None:
        self.findings: list[Finding] = []
        self._type, self._store = type_name, store
        self._stamped: list[Any] = []
        self._message = self._build(type_name, value, "value")

    def payload(self, stamp: int) -> bytes:
        """The message as it is published at a moment, in ns since 1970."""
        time = self._store.types[TIME](*divmod(stamp, 10**9))
        for header in self._stamped:
            header.stamp = time
        return bytes(self._store.serialize_cdr(self._message, self._type))

    def definition(self) -> tuple[str, str, str]:
        """The type's name, its .msg text with all that it contains, and its hash (RIHS01_...)."""
        text, _ = self._store.generate_msgdef(self._type, ros_version=2)
        return self._type, text, self._store.hash_rihs01(self._type)

    def _build(self, type_name: str, value: object, path: str) -> Any:
        fields = dict(self._store.fielddefs[type_name][1])
        given = value if isinstance(value, dict) else {}
        if not isinstance(value, dict):
            self._refuse(path, value, f"an object with fields of {type_name}")
        for name in given.keys() - fields.keys():
            known = f"one of the fields {', '.join(fields)} of {type_name}"
            self.findings.append(Finding(f"{path}.{name}", given[name], known, Fault.FIELD))
        built = {
            normalize_fieldname(name): self._field(description, given.get(name), f"{path}.{name}")
            for name, description in fields.items()
        }
        message = self._store.types[type_name](**built)
        if type_name == HEADER and "stamp" not in given:
            self._stamped.append(message)
        return message

    def _field(self, description: Any, value: object, path: str) -> Any:
        """A field's value; its default for None."""
        kind, detail = description
        if kind is Nodetype.NAME:
            return self._build(detail, {} if value is None else value, path)
        if kind is Nodetype.BASE:
            return self._plain(detail[0], value, path)
        element, size = detail
        items = self._items(kind, size, value, path)
        built = [self._field(element, item, f"{path}[{index}]") for index, item in enumerate(items)]
        if element[0] is Nodetype.BASE and element[1][0] != "string":
            return np.array(built, dtype=_PLAIN[element[1][0]].dtype)
        return built

    def _items(self, kind: Any, size: int, value: object, path: str) -> Sequence[object]:
        """The items of a list; an omitted array of fixed length has that many omitted items."""
        fixed = kind is Nodetype.ARRAY
        if value is None:
            return [None] * size if fixed else []
        if not isinstance(value, list) or (fixed and len(value) != size) or (size and len(value) > size):
            length = f" of {'' if fixed else 'at most '}{size}" if size else ""
            self._refuse(path, value, f"a list{length}")
            return [None] * size if fixed else []
        return value

    def _plain(self, kind: str, value: object, path: str) -> Any:
        plain = _PLAIN[kind]
        read = plain.default if value is None else plain.read(value)
        if read is None:
            self._refuse(path, value, plain.allowed)
        return plain.default if read is None else read

    def _refuse(self, path: str, value: object, allowed: str) -> None:
        self.findings.append(Finding(path, value, allowed))


class _Plain(NamedTuple):
    """A primitive type: its default, how it reads JSON (None for what does not fit), and its numpy dtype in arrays."""

    default: Any
    read: Callable[[object], Any]
    allowed: str
    dtype: str


def _text(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _flag(value: object) -> bool | None:
    return value if isinstance(value, bool) else None


def _real(largest: float) -> Callable[[object], float | None]:
    def read(value: object) -> float | None:
        if isinstance(value, str):
            return _NOT_FINITE.get(value)
        if isinstance(value, bool) or not isinstance(value, int | float) or not -largest <= value <= largest:
            return None
        return float(value)

    return read


def _whole(bits: int, dtype: str, *, signed: bool = False) -> _Plain:
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)

    def read(value: object) -> int | None:
        return value if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high else None

    return _Plain(0, read, f"an integer from {low} to {high}", dtype)


_REAL_WORDS = 'a number, "NaN", "Infinity" or "-Infinity"'
_PLAIN = {
    "string": _Plain("", _text, "a string", "str"),
    "bool": _Plain(default=False, read=_flag, allowed="true or false", dtype="bool"),
    "float32": _Plain(0.0, _real(3.4028234663852886e38), _REAL_WORDS, "float32"),
    "float64": _Plain(0.0, _real(1.7976931348623157e308), _REAL_WORDS, "float64"),
    **{name: _whole(8, "uint8") for name in ("byte", "char")},
    **{f"uint{bits}": _whole(bits, f"uint{bits}") for bits in (8, 16, 32, 64)},
    **{f"int{bits}": _whole(bits, f"int{bits}", signed=True) for bits in (8, 16, 32, 64)},
}
