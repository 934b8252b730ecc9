"""What the parser accepts, as it says itself: it reads an object that has every field, and each reading is noted."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass
from typing import Any

from contextpolicy.policy import parsing
from contextpolicy.policy.fields import Fields

NO_READERS = {"refuse", "at"}
READERS = [
    name
    for name, method in inspect.getmembers(Fields, inspect.isfunction)
    if "name" in inspect.signature(method).parameters and not name.startswith("_") and name not in NO_READERS
]
"""The methods of `Fields` that read a field."""
INSIDE = {
    "nested": ("", lambda inner: inner),
    "nested_list": ("[]", lambda inner: [inner]),
    "mapping": (".*", lambda inner: {"*": inner}),
}
"""For those that go on inside the field: what that adds to its path, and what they return."""


@dataclass(frozen=True)
class Reading:
    """The method that reads a field, and its arguments."""

    reader: str
    arguments: dict[str, Any]


class Recorder(Fields):
    """An object that has every field, none of them with a value."""

    def __init__(self, path, readings):
        super().__init__({}, path, [])
        self.readings = readings

    def __contains__(self, name):
        return True

    def note(self, reader, name, **arguments):
        """Keep the first reading that says what the field is: `raw` does not, and the other readers call it."""
        known = self.readings.get(self.at(name))
        if known is None or known.reader == "raw":
            self.readings[self.at(name)] = Reading(reader, arguments)


def _recording(reader):
    method = getattr(Fields, reader)

    def read(self, *positional, **named):
        bound = inspect.signature(method).bind(self, *positional, **named)
        bound.apply_defaults()
        _, *arguments = bound.arguments.items()
        self.note(reader, **dict(arguments))
        if reader not in INSIDE:
            return method(self, *positional, **named)
        step, wrap = INSIDE[reader]
        return wrap(Recorder(self.at(bound.arguments["name"]) + step, self.readings))

    return read


for one in READERS:
    setattr(Recorder, one, _recording(one))


def readings():
    """How the parser reads each field, by its path in the schema."""
    noted: dict[str, Any] = {}
    parsing._policy("lab", "robot", Recorder("spec", noted))
    return noted


def holding(path, value):
    """The smallest object that has the value at a path of the schema."""
    for step in reversed(re.findall(r"\[\]|[^.\[\]]+", path)):
        value = [value] if step == "[]" else {step: value}
    return value


def parsed(path, value):
    """What the parser makes of that object, and what it refuses: values by path."""
    findings: list[Any] = []
    policy = parsing._policy("lab", "robot", Fields(holding(path, value)["spec"], "spec", findings))
    return policy, {finding.field.replace("[0]", "[]"): finding.value for finding in findings}
