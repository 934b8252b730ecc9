"""JSON that every reader accepts, and nothing else: it has no NaN and no Infinity, which become null, "no value"."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

LONGEST = len("-9223372036854775808")


def dumps(value: object) -> str:
    """Serialize a value; numpy's numbers and arrays become numbers and lists. TypeError for what JSON can't hold."""
    try:
        return json.dumps(value, allow_nan=False, default=_plain)
    except ValueError:  # NaN or Infinity: rare, so the value is searched only now
        return json.dumps(_finite(value), allow_nan=False)


def loads(text: bytes | str) -> Any:
    """Parse a received text. Raises ValueError for anything that is wrong with it.

    That includes what Python's parser takes or chokes on: NaN, integers longer than any of 64 bits (no float can be
    made of some), and lists nested too deep.
    """
    try:
        return json.loads(text, parse_int=_integer, parse_constant=_refuse)
    except RecursionError as error:
        raise ValueError("nested too deep") from error


def _integer(digits: str) -> int:
    if len(digits) > LONGEST:
        raise ValueError(f"{digits[:LONGEST]}... is longer than any integer of 64 bits")
    return int(digits)


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is not JSON")


def _plain(value: Any) -> object:
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):  # numpy, which this package does not need otherwise
        return value.tolist()
    raise TypeError(f"JSON has no {type(value).__name__}")


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _finite(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return value if value is None or isinstance(value, str | int) else _finite(_plain(value))
