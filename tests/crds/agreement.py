"""Where the parser and the definition's schema disagree on a field."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from typing import Any

import yaml

from contextpolicy.policy.fields import Fields
from contextpolicy.policy.quantities import CPU_ALLOWED, DURATION_ALLOWED
from contextpolicy.policy.validation.crd_words import PATTERNS
from tests.crds.reading import parsed, readings, values
from tests.crds.schema import nodes

LAXER = {"spec.streams"}
"""Required by the API server only: a policy in a file may begin without."""
ANY_TEXT = inspect.signature(Fields.text).parameters["pattern"].default
STATED = re.compile(r"Default:? ([\w.]*\w)\b(?!, or)")
STATING = {"choice", "flag", "number", "whole", "cpu", "memory", "duration"}
"""Readers of fields whose default is a word of the description, where the schema has none."""


def pattern_of(words):
    """The definition's pattern for what messages describe so."""
    return next(pattern for pattern, described in PATTERNS.items() if described.startswith(words))


QUANTITIES = {
    "cpu": pattern_of(CPU_ALLOWED),
    "memory": pattern_of("a memory quantity"),
    "duration": pattern_of(DURATION_ALLOWED),
}
SAYS = {
    "cel": lambda _: {"type": "string"},
    "choice": lambda reading: {
        "type": "string",
        "enum": sorted(type(reading.arguments["default"]).__members__.values()),
    },
    "cpu": lambda _: {"x-kubernetes-int-or-string": True, "pattern": QUANTITIES["cpu"]},
    "duration": lambda _: {"type": "string", "pattern": QUANTITIES["duration"]},
    "flag": lambda _: {"type": "boolean"},
    "key_expression": lambda _: {"type": "string"},
    "mapping": lambda reading: {"type": "object", "items": "object", "maxProperties": reading.arguments["limit"]},
    "memory": lambda _: {"x-kubernetes-int-or-string": True, "pattern": QUANTITIES["memory"]},
    "moment": lambda _: {"type": "string", "format": "date-time"},
    "nested": lambda _: {"type": "object"},
    "nested_list": lambda reading: {"type": "array", "items": "object", "maxItems": reading.arguments["limit"]},
    "number": lambda _: {"type": "number"},
    "optional_text": lambda _: {"type": "string"},
    "raw": lambda _: {"x-kubernetes-preserve-unknown-fields": True},
    "string_map": lambda _: {"type": "object", "items": "string"},
    "text": lambda _: {"type": "string"},
    "whole": lambda reading: {"type": "integer", "minimum": 1, "maximum": reading.arguments["most"]},
    "texts": lambda reading: {"type": "array", "items": "string", "maxItems": reading.arguments["limit"]},
}
"""What the definition has to say of a field, by the method that the parser reads it with."""
NOTHING = {"cpu": 0, "duration": "0s", "flag": False, "memory": 0, "number": 0}
"""What changes nothing unless the field has another default."""
LONG = {"key_expression": lambda length: "*/".ljust(length, "k"), "cel": "true".ljust}
"""What these methods read, in any length."""


def disagreements(spec):
    """All of them as sentences that begin with the field's path; `spec` is the schema of `.spec`."""
    read, defined = readings(), fields(spec)
    yield from (f"{path}: the definition lacks it, so the API server drops it" for path in read.keys() - defined.keys())
    yield from (f"{path}: the parser refuses it, it knows no such field" for path in defined.keys() - read.keys())
    for path in sorted(read.keys() & defined.keys()):
        for rule in (_kind, _bounds, _default):
            yield from (f"{path}: {what}" for what in rule(path, read[path], defined[path]))
    yield from _required(spec)


def fields(spec):
    """Every field of the schema, by path; items and entries belong to the field that holds them."""
    return {path: node for path, node in nodes(spec, "spec") if path != "spec" and not path.endswith(("[]", ".*"))}


def _kind(_, reading, node):
    """Type, enumeration, format and lengths of lists."""
    inner = node.get("items", node.get("additionalProperties", {}))
    stated = node | {"enum": sorted(node.get("enum", ())), "items": inner.get("type")}
    for keyword, value in (SAYS[reading.reader](reading) | _pattern(reading, node)).items():
        if stated.get(keyword) != value:
            yield f"{keyword} is {value} for the parser, {stated.get(keyword)} in the definition"


def _pattern(reading, node):
    """What a string must match, where the parser says it; a lookahead says its length."""
    pattern = reading.arguments.get("pattern", ANY_TEXT)
    text = pattern.pattern if isinstance(pattern, re.Pattern) else pattern
    if text == ANY_TEXT:
        return {}
    if "enum" in node:
        return {"enum": sorted(text.split("|"))}
    length = f"(?=.{{1,{node.get('maxLength')}}}$)"
    return {"pattern": f"^{text.removeprefix(length)}$"}


def _bounds(path, reading, node):
    """The parser takes what is within the definition's bounds, and where it has bounds itself, nothing beyond."""
    edges: list[tuple[Any, Any, Any]] = []
    if reading.reader == "number":
        least, most = node.get("minimum", -math.inf), node.get("maximum", math.inf)
        edges = [(least, math.nextafter(least, -math.inf), -1e300), (most, math.nextafter(most, math.inf), 1e300)]
    elif reading.reader in LONG:
        of_length, longest = LONG[reading.reader], node.get("maxLength", 0)
        edges = [(of_length(longest), of_length(longest + 1), of_length(10_000))]
    for last, beyond, far in edges:
        if refuses(path, last):
            yield f"the parser refuses {last!r:.40}, which the definition allows"
        if refuses(path, far) and not refuses(path, beyond):
            yield f"the parser takes {beyond!r:.40}, which the definition does not"


def _default(path, reading, node):
    """To leave a field out means the default that the schema states, or else its description."""
    reported = STATED.search(node.get("description", "")) if reading.reader in STATING else None
    stated = [node["default"]] if "default" in node else [yaml.safe_load(reported[1])] if reported else []
    absent, missed = parsed(path.rpartition(".")[0], {})
    for default in stated:
        if parsed(path, default)[0] != absent or ("default" in node and refuses(path, default)):
            yield f"its default is {default!r} in the definition, not for the parser"
    if reading.reader == "choice" and not stated and path not in missed:
        yield f"its default is {reading.arguments['default']!s} for the parser, none in the definition"
    valueless = all(refuses(path, default) for default in stated)  # such as "all of N"
    if reading.reader in NOTHING and valueless and any(_changed(absent, parsed(path, NOTHING[reading.reader])[0])):
        yield "it has a default for the parser, none in the definition"


def _changed(absent, nothing):
    """The numbers without a field, where they differ from the field's nothing."""
    for one, other in zip(values(absent), values(nothing), strict=True):
        for each in dataclasses.fields(one):
            own = getattr(one, each.name)
            if isinstance(own, int | float) and own != getattr(other, each.name):
                yield own


def _required(spec):
    """What the parser misses in an empty object is required, or asked for by a rule, and the other way round."""
    for path, node in nodes(spec, "spec"):
        if "properties" not in node:
            continue
        rules = " ".join(rule["rule"] for rule in node.get("x-kubernetes-validations", ()))
        refused = parsed(path, {})[1]
        missed = {name for name in node["properties"] if refused.get(f"{path}.{name}", "not refused") is None}
        required = {*node.get("required", ())}
        yield from (
            f"{path}.{name}: required by the parser, not by the definition"
            for name in missed - required
            if f"has(self.{name})" not in rules
        )
        yield from (
            f"{path}.{name}: required by the definition, not by the parser"
            for name in required - missed
            if f"{path}.{name}" not in LAXER
        )


def refuses(path, value):
    """Whether the parser refuses this value of a field."""
    return path in parsed(path, value)[1]
