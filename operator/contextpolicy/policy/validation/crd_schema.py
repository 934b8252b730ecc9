"""What the API server refuses by the resource definition's schema: types, bounds, enumerations, patterns, names.

Reads the definition itself, so nothing here has to be kept in step with it; `crd_rules` has its CEL rules.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

import yaml
from jsonschema import Draft202012Validator, FormatChecker, ValidationError, validators

from contextpolicy.errors import Fault, Finding
from contextpolicy.policy.custom_resource import DEFINITION
from contextpolicy.policy.validation.crd_words import allowed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

DEFINITION_FILE = f"{DEFINITION}.yaml"
"""Copied from crds/ by `make crds`: an installed package has no repository around it."""

_LABEL = "[a-z0-9]([a-z0-9-]*[a-z0-9])?"
_METADATA = {
    "type": "object",
    "x-kubernetes-preserve-unknown-fields": True,
    "properties": {
        "name": {"type": "string", "maxLength": 253, "pattern": rf"^{_LABEL}(\.{_LABEL})*$"},
        "namespace": {"type": "string", "maxLength": 63, "pattern": f"^{_LABEL}$"},
    },
}
"""The API server's own rules for every object's metadata, which no resource definition states."""

_DATE = re.compile(r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)", re.ASCII)


@cache
def schema() -> dict[str, Any]:
    """The openAPIV3Schema with rules for metadata added, and any status accepted: the operator writes it."""
    text = resources.files(__package__).joinpath(DEFINITION_FILE).read_text(encoding="utf-8")
    (version,) = yaml.safe_load(text)["spec"]["versions"]
    root: dict[str, Any] = version["schema"]["openAPIV3Schema"]
    root["properties"] |= {"metadata": _METADATA, "status": {}}
    return root


def findings(stored: Mapping[str, Any]) -> Iterator[Finding]:
    """The first thing that is wrong with each field of an object from `as_stored`."""
    reported = set()
    for error in _validator().iter_errors(stored):
        field = _path(error.absolute_path)
        if field not in reported:
            reported.add(field)
            fault = Fault.FIELD if error.validator == "properties" else Fault.VALUE
            yield Finding(field, error.instance, allowed(error, field), fault)


def as_stored(value: Any, node: Mapping[str, Any]) -> Any:
    """The value as the API server would store it: nulls dropped, defaults filled in."""
    if isinstance(value, list):
        return [as_stored(item, node.get("items", {})) for item in value]
    if not isinstance(value, dict):
        return value
    known, other = node.get("properties", {}), node.get("additionalProperties", {})
    given = {name: inner for name, inner in value.items() if inner is not None}
    defaults = {name: inner["default"] for name, inner in known.items() if "default" in inner}
    return {name: as_stored(inner, known.get(name, other)) for name, inner in (defaults | given).items()}


@cache
def _validator() -> Draft202012Validator:
    dates = FormatChecker(formats=())
    dates.checks("date-time")(lambda value: not isinstance(value, str) or _DATE.fullmatch(value) is not None)
    kubernetes = {
        "items": _items,
        "pattern": _pattern,
        "properties": _properties,
        "required": _required,
        "x-kubernetes-list-type": _unique,
    }
    return validators.extend(Draft202012Validator, kubernetes)(schema(), format_checker=dates)


def _items(validator: Any, item: Any, items: Any, node: Mapping[str, Any]) -> Iterator[ValidationError]:
    """Skip the items of a list that is too long: its length is the finding."""
    if isinstance(items, list) and len(items) <= node["maxItems"]:
        yield from Draft202012Validator.VALIDATORS["items"](validator, item, items, node)


def _pattern(_: Any, pattern: str, value: Any, __: Any) -> Iterator[ValidationError]:
    """Match to the very end: Python's `$` also matches before a trailing newline, the API server's does not."""
    if isinstance(value, str) and not re.fullmatch(pattern, value):
        yield ValidationError("does not match")


def _properties(
    validator: Any, known: Mapping[str, Any], value: Any, node: Mapping[str, Any]
) -> Iterator[ValidationError]:
    yield from Draft202012Validator.VALIDATORS["properties"](validator, known, value, node)
    if isinstance(value, dict) and not node.get("x-kubernetes-preserve-unknown-fields"):
        # kubectl's strict validation refuses these; the API server by default drops them with a warning.
        for name in value.keys() - known.keys():
            yield ValidationError("is unknown", path=[name], instance=value[name])


def _required(_: Any, names: Iterable[str], value: Any, node: Mapping[str, Any]) -> Iterator[ValidationError]:
    """Report the field that is missing, where jsonschema reports the object around it."""
    for name in names if isinstance(value, dict) else ():
        if name not in value:
            yield ValidationError("is missing", path=[name], instance=None, schema=node["properties"][name])


def _unique(_: Any, kind: str, items: Any, node: Mapping[str, Any]) -> Iterator[ValidationError]:
    """Two items with the same key in a `map`, or the same item twice in a `set`."""
    if kind == "atomic" or not isinstance(items, list):
        return
    keys = node.get("x-kubernetes-list-map-keys")
    names = [_key(item, keys) for item in items]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield ValidationError("appears twice", instance=name)


def _key(item: Any, keys: Iterable[str] | None) -> Any:
    if keys is None or not isinstance(item, dict):
        return item
    return " ".join(str(item.get(key)) for key in keys)


def _path(parts: Iterable[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")
