"""Reading one object of a spec, field by field: findings are collected, not raised, to report all at once."""

from __future__ import annotations

import re
from datetime import datetime
from typing import TYPE_CHECKING, Any, TypeVar

from contextpolicy.errors import Fault, Finding
from contextpolicy.policy import quantities
from contextpolicy.policy.key_expressions import excess, refusal
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable
    from enum import StrEnum

Choice = TypeVar("Choice", bound="StrEnum")
Parsed = TypeVar("Parsed")

STREAM_NAME = re.compile(r"[a-z][a-z0-9_]{0,62}")
TASK_NAME = re.compile(r"[a-z][a-z0-9-]{0,62}")
FEATURE_NAME = re.compile(r"[a-z][A-Za-z0-9_]{0,62}")
STREAM_NAME_ALLOWED = "at most 63 lower-case letters, digits and '_', a letter first (it is a CEL variable)"
TASK_NAME_ALLOWED = "at most 63 lower-case letters, digits and '-', a letter first"
FEATURE_NAME_ALLOWED = "at most 63 letters, digits and '_', a lower-case letter first"
OBJECT_NAME = re.compile(r"(?=.{1,253}$)[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*")
ROS_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")
FIELD_PATH = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*")
LARGEST = 1e308
"""Close to the largest float; integers can be larger and would overflow."""
LARGEST_WEIGHT = 1_000_000
"""The greatest priority, score, weight or scale, as in the definition."""

KEY_ALLOWED = "a Zenoh key expression of at most 256 characters, such as robot/imu or robot/*/imu"

MOST_FINDINGS = 100
"""The most that are reported of one policy: each says what is expected, which may be a long list."""


class Fields:
    """The fields of one object. Reading a field makes its name known; `close` refuses the others."""

    def __init__(self, raw: object, path: str, findings: list[Finding]) -> None:
        self.path = path
        self._findings = findings
        self._known: set[str] = set()
        self._nested: dict[str, Fields] = {}
        self._raw: dict[str, Any] = {}
        if isinstance(raw, dict):
            self._raw = raw
        else:
            self.refuse("", raw, "an object")

    def __contains__(self, name: str) -> bool:
        return self._raw.get(name) is not None

    def refuse(self, name: str, value: object, allowed: str) -> None:
        """Note that a field has an invalid value."""
        self._note(Finding(self.at(name), value, allowed))

    def _note(self, finding: Finding) -> None:
        if len(self._findings) < MOST_FINDINGS:
            self._findings.append(finding)

    def at(self, name: str) -> str:
        """The field's full path."""
        return ".".join(filter(None, (self.path, name)))

    def raw(self, name: str) -> Any:
        """The field's raw value; None when it is absent."""
        self._known.add(name)
        return self._raw.get(name)

    def text(
        self,
        name: str,
        default: str | None = None,
        *,
        allowed: str = "a string",
        pattern: str | re.Pattern[str] = r"(?s).+",
    ) -> str:
        """A string that matches the whole pattern; required when there is no default."""
        value = self.raw(name)
        if value is None and default is not None:
            return default
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            self.refuse(name, value, allowed)
            return ""
        return value

    def optional_text(
        self, name: str, *, allowed: str = "a string", pattern: str | re.Pattern[str] = r"(?s).+"
    ) -> str | None:
        """As `text`, None when the field is absent."""
        return self.text(name, allowed=allowed, pattern=pattern) if name in self else self.raw(name)

    def key_expression(self, name: str) -> str:
        """A required Zenoh key expression."""
        value = self.text(name, allowed=KEY_ALLOWED, pattern=r"(?s).{1,256}")
        reason = (refusal(value) or excess(value)) if value else ""
        if reason:
            self.refuse(name, value, f"{KEY_ALLOWED}; {reason}")
        return value

    def choice(self, name: str, default: Choice) -> Choice:
        """One of the words of an enumeration."""
        value = self.raw(name)
        kind = type(default)
        if value is None:
            return default
        if value not in list(kind):
            self.refuse(name, value, "one of " + ", ".join(kind))
            return default
        return kind(value)

    def number(self, name: str, *, most: float = LARGEST) -> float | None:
        """A number from 0 to `most`."""
        value = self.raw(name)
        if value is None:
            return None
        if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value <= most:
            self.refuse(name, value, f"a number from 0 to {most:.15g}")
            return None
        return float(value)

    def whole(self, name: str, *, most: int) -> int | None:
        """An integer from 1 to `most`."""
        value = self.raw(name)
        if value is None:
            return None
        if type(value) is not int or not 1 <= value <= most:
            self.refuse(name, value, f"an integer from 1 to {most}")
            return None
        return value

    def cpu(self, name: str) -> int | None:
        """A CPU quantity in thousandths of a core."""
        return self._parsed(name, quantities.parse_cpu, quantities.CPU_ALLOWED)

    def memory(self, name: str) -> int | None:
        """A memory quantity in bytes."""
        return self._parsed(name, quantities.parse_memory, quantities.MEMORY_ALLOWED)

    def duration(self, name: str) -> float | None:
        """A duration in seconds."""
        return self._parsed(name, quantities.parse_duration, quantities.DURATION_ALLOWED)

    def moment(self, name: str) -> float:
        """A date and time with zone, in Unix seconds."""
        value = self.raw(name)
        try:
            moment = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
        except ValueError:
            moment = datetime.min  # noqa: DTZ901 - a date without zone is refused below
        if moment.tzinfo is None:
            self.refuse(name, value, "a date and time with zone, such as 2026-11-21T12:00:00Z")
            return 0.0
        return moment.timestamp()

    def cel(self, name: str) -> str | None:
        """A CEL expression that compiles and calls known functions only; its variables are checked by `references`."""
        value = self.raw(name)
        if value is None:
            return None
        from contextpolicy.policy import cel_mistakes  # noqa: PLC0415 - router and agent read fields without any
        from contextpolicy.policy.cel import Expression  # noqa: PLC0415

        try:
            unknown = Expression(value).unknown_functions if isinstance(value, str) else None
        except ValueError as error:
            self.refuse(name, value, f"a CEL expression; {cel_mistakes.explain(str(value), error)}")
            return None
        if unknown is None or unknown:
            self.refuse(name, value, "a CEL expression" if unknown is None else cel_mistakes.unknown(unknown))
            return None
        return str(value)

    def flag(self, name: str) -> bool:
        """A boolean, False when absent; 0 and 1 are refused, although they equal False and True."""
        value = self.raw(name)
        if value not in (None, True, False) or (isinstance(value, int | float) and not isinstance(value, bool)):
            self.refuse(name, value, "true or false")
        return value is True

    def nested(self, name: str) -> Fields:
        """A nested object; an absent one reads as empty."""
        value = self.raw(name)
        self._nested[name] = Fields({} if value is None else value, self.at(name), self._findings)
        return self._nested[name]

    def nested_list(self, name: str, *, limit: int) -> list[Fields]:
        """A list of objects."""
        return [Fields(item, f"{self.at(name)}[{i}]", self._findings) for i, item in enumerate(self._list(name, limit))]

    def texts(self, name: str, *, limit: int) -> tuple[str, ...]:
        """A list of non-empty strings."""
        items = self._list(name, limit)
        for index, item in enumerate(items):
            if not isinstance(item, str) or not item:
                self.refuse(f"{name}[{index}]", item, "a string")
        return tuple(item for item in items if isinstance(item, str))

    def mapping(self, name: str, *, limit: int) -> dict[str, Fields]:
        """A map from names to objects."""
        entries = self._entries(name)
        if len(entries) > limit:
            self.refuse(name, f"{len(entries)} entries", f"at most {limit} entries")
        return {str(key): Fields(value, f"{self.at(name)}.{key}", self._findings) for key, value in entries.items()}

    def string_map(self, name: str) -> dict[str, str]:
        """A map from strings to strings, as labels are."""
        entries = self._entries(name)
        for key, value in entries.items():
            if not isinstance(value, str):
                self.refuse(f"{name}.{key}", value, "a string")
        return {str(key): str(value) for key, value in entries.items()}

    def close(self) -> None:
        """Refuse the fields that were not read: a misspelt name must not be ignored."""
        for name in [name for name in self._raw if name not in self._known]:
            known = f"one of the fields {', '.join(sorted(self._known))}{self._meant(name)}"
            self._note(Finding(self.at(str(name)), self._raw[name], known, Fault.FIELD))

    def is_blank(self) -> bool:
        """Whether the user gave nothing: no value of any field, known or not."""
        return not any(self._raw.values())

    def has_read(self, field: str) -> bool:
        """Whether the field is known, present or not."""
        return field in self._known

    def _meant(self, field: object) -> str:
        """What an unknown field may stand for: one that belongs into a nested object, or a similar name."""
        inside = [f"{name}.{field}" for name, inner in self._nested.items() if inner.has_read(str(field))]
        return f"; did you mean {inside[0]}?" if inside else did_you_mean(field, self._known)

    def _entries(self, name: str) -> dict[Any, Any]:
        value = self.raw(name)
        if value is None or isinstance(value, dict):
            return value or {}
        self.refuse(name, value, "an object")
        return {}

    def _list(self, name: str, limit: int) -> list[Any]:
        value = self.raw(name)
        if value is None:
            return []
        if not isinstance(value, list):
            self.refuse(name, value, "a list")
            return []
        if len(value) > limit:
            self.refuse(name, f"{len(value)} items", f"at most {limit} items")
        return value[:limit]

    def _parsed(self, name: str, parse: Callable[[object], Parsed], allowed: str) -> Parsed | None:
        value = self.raw(name)
        if value is None:
            return None
        try:
            return parse(value)
        except ValueError:
            self.refuse(name, value, allowed)
            return None
