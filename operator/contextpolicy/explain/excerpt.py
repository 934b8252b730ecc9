"""A stream's value for display: JSON, of bounded size whatever a sender puts into a sample."""

from __future__ import annotations

import math
from typing import Any

LONGEST_LIST = 16
"""Items: a laser scan has thousands of numbers."""
LONGEST_MAP = 64
"""Fields."""
LONGEST_TEXT = 256
"""Characters, of a key as well."""
LARGEST = 1024
"""Bits of an integer, which is as far as doubles go."""
MOST = 256
"""Values altogether; one condition may show the same value in several places."""


def excerpt(value: Any) -> Any:
    """The value with what is too long cut, and what JSON has no word for as text."""
    return _Excerpt().of(value)


class _Excerpt:
    def __init__(self) -> None:
        self._left = MOST

    def of(self, value: Any) -> Any:
        self._left -= 1
        match value:
            case dict():
                return self._map(value)
            case list():
                return self._list(value)
            case bytes():
                return f"{len(value)} bytes"
            case float() if not math.isfinite(value):
                return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
            case int() if value.bit_length() > LARGEST:
                return f"an integer of {value.bit_length()} bits"
        return value if value is None or isinstance(value, bool | int | float) else _text(str(value))

    def _map(self, value: dict[Any, Any]) -> dict[str, Any]:
        shown: dict[str, Any] = {}
        for name, inner in value.items():
            if len(shown) == LONGEST_MAP or self._left <= 0:
                return {**shown, "...": f"and {len(value) - len(shown)} more"}
            shown[_text(str(name))] = self.of(inner)
        return shown

    def _list(self, value: list[Any]) -> list[Any]:
        shown: list[Any] = []
        for item in value:
            if len(shown) == LONGEST_LIST or self._left <= 0:
                return [*shown, f"and {len(value) - len(shown)} more"]
            shown.append(self.of(item))
        return shown


def _text(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}... and {len(text) - LONGEST_TEXT} more"
