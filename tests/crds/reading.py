"""What the parser accepts, as it says itself: it reads objects that have any field, and each reading is noted."""

from __future__ import annotations

import inspect
import random
import re
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import chain
from typing import Any

from contextpolicy.policy import parsing, stream_parsing, task_parsing
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
VALUES = {
    "cel": ["true"],
    "cpu": [0, 500, 64_000],
    "duration": [0.0, 0.05, 3600.0],
    "flag": [False, True],
    "key_expression": ["robot/*/imu"],
    "memory": [0, 2**40],
    "moment": [0.0, 2e9],
    "number": [0.0, 0.5, 1.0, 1000.0],
    "raw": ["text", {}],
    "string_map": [{"text": "text"}],
    "texts": [("text",)],
    "whole": [1],
}
"""What the others return, besides the default: one of each kind that a parser may treat differently."""
WORDS = re.compile(r"\w+(\|\w+)+")
ROUNDS = 300
"""How many objects the parser reads: enough for each pair of words to occur."""


@dataclass(frozen=True)
class Reading:
    """The method that reads a field, and its arguments."""

    reader: str
    arguments: dict[str, Any]


class Recorder(Fields):
    """An object of which every field may be there or not, with any value, by chance."""

    def __init__(self, path, readings, chance):
        super().__init__({}, path, [])
        self.readings = readings
        self.chance = chance
        self.present: dict[str, bool] = {}
        self.drawn: dict[tuple[str, str], Any] = {}

    def __contains__(self, name):
        return self.has(name)

    def has(self, name, values=1):
        """Whether a field is there; to be absent is as likely as each of its values."""
        return self.present.setdefault(name, self.chance.randint(0, values) > 0)

    def note(self, reader, name, **arguments):
        """Keep the first reading that says what the field is: `raw` does not, and the other readers call it."""
        known = self.readings.get(self.at(name))
        if known is None or known.reader == "raw":
            self.readings[self.at(name)] = Reading(reader, arguments)


def _recording(reader):
    method = getattr(Fields, reader)
    signature = inspect.signature(method)

    def read(self, *positional, **named):
        bound = signature.bind(self, *positional, **named)
        bound.apply_defaults()
        _, *arguments = bound.arguments.items()
        self.note(reader, **dict(arguments))
        name, values = bound.arguments["name"], _values(self, reader, bound.arguments)
        if not self.has(name, len(values)):
            return method(self, *positional, **named)
        return self.drawn.setdefault((reader, name), self.chance.choice(values))

    return read


def _values(recorder, reader, arguments):
    """What a method may return for a field that is there."""
    if reader in INSIDE:
        step, wrap = INSIDE[reader]
        return [wrap(Recorder(recorder.at(arguments["name"]) + step, recorder.readings, recorder.chance))]
    if reader == "choice":
        return [*type(arguments["default"]).__members__.values()]
    pattern = arguments.get("pattern", "")
    words = isinstance(pattern, str) and WORDS.fullmatch(pattern)
    return VALUES.get(reader) or (pattern.split("|") if words else ["text"])


for one in READERS:
    setattr(Recorder, one, _recording(one))


def readings():
    """How the parser reads each field, by its path in the schema: the union of what it reads of many objects."""
    read = (vars(module).values() for module in (parsing, stream_parsing, task_parsing))
    return _readings(tuple(filter(inspect.isfunction, chain.from_iterable(read))))


@cache
def _readings(_parsers):
    """Once for each version of the parser's functions, of which a test may replace some."""
    noted: dict[str, Any] = {}
    chance = random.Random(0)  # noqa: S311 - the same objects each time, no secret
    for _ in range(ROUNDS):
        parsing._policy("lab", "robot", Recorder("spec", noted, chance))
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


def values(policy):
    """The policy and all values in it."""
    yield policy
    for each in fields(policy):
        inner = getattr(policy, each.name)
        found = inner.values() if isinstance(inner, dict) else inner if isinstance(inner, tuple) else (inner,)
        for one in found:
            if is_dataclass(one):
                yield from values(one)
