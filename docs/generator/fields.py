"""The reference page of a ContextPolicy's fields, from the resource definition."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from docs.generator.markdown import escaped, table

if TYPE_CHECKING:
    from collections.abc import Iterator

DEFINITION = Path(__file__).parents[2] / "crds" / "contextpolicies.contextpolicy.dev.yaml"
LONGEST = 500
"""Characters of a description that a table's cell shows whole."""
_SENTENCE = re.compile(r"(?<=\.)\s+(?=[A-Z])")
_INTRODUCTION = """\
# The fields of a ContextPolicy

`make docs` writes this page from `crds/contextpolicies.contextpolicy.dev.yaml`; `kubectl explain ctxp.spec` shows the
same descriptions. `[]` stands for an item of a list, `.*` for an entry of a map. The
[cookbook](../../config/policies/README.md) and the [examples](../../config/examples) use every field.
"""
_BOUNDS = (
    ("", "minimum", "maximum"),
    (" characters", "minLength", "maxLength"),
    (" items", "minItems", "maxItems"),
    (" entries", "minProperties", "maxProperties"),
)


def page() -> str:
    """The page as Markdown."""
    (version,) = yaml.safe_load(DEFINITION.read_text(encoding="utf-8"))["spec"]["versions"]
    properties = version["schema"]["openAPIV3Schema"]["properties"]
    sections = (line for name in ("spec", "status") for line in _section(name, properties[name]))
    return "\n".join([_INTRODUCTION, *sections])


def _section(path: str, schema: dict[str, Any]) -> Iterator[str]:
    """The fields of one object, what is checked across them, then the objects in them."""
    fields, required = schema["properties"], schema.get("required", [])
    yield from (f"## `{path}`", "", schema.get("description", "").strip(), "")
    yield from table(
        ("field", "type", "default", "meaning"),
        [
            (f"`{name}`" + (" (required)" if name in required else ""), _type(field), _default(field), _meaning(field))
            for name, field in fields.items()
        ],
    )
    yield from _details(fields)
    yield from _rules(schema)
    for name, field in fields.items():
        yield from _inner(f"{path}.{name}", field)


def _inner(path: str, schema: dict[str, Any]) -> Iterator[str]:
    if "properties" in schema:
        yield from _section(path, schema)
    if "items" in schema:
        yield from _inner(f"{path}[]", schema["items"])
    if isinstance(schema.get("additionalProperties"), dict):
        yield from _inner(f"{path}.*", schema["additionalProperties"])


def _details(fields: dict[str, dict[str, Any]]) -> Iterator[str]:
    """The descriptions that are too long for a table's cell."""
    for name, field in fields.items():
        if _is_long(field):
            yield from (f"**`{name}`**: {escaped(field['description'])}", "")


def _rules(schema: dict[str, Any]) -> Iterator[str]:
    messages = [_message(rule) for rule in schema.get("x-kubernetes-validations", []) if "message" in rule]
    if messages:
        yield from ("Messages with which the API server refuses it:", "")
        yield from (*(f"- {message}" for message in dict.fromkeys(messages)), "")


def _message(rule: dict[str, Any]) -> str:
    field = rule.get("fieldPath", "").removeprefix(".")
    return (f"`{field}`: " if field else "") + escaped(rule["message"])


def _type(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "items" in schema:
        return f"list of {schema['items'].get('type', 'values')}s"
    if isinstance(schema.get("additionalProperties"), dict):
        return f"map of {schema['additionalProperties'].get('type', 'value')}s"
    if schema.get("x-kubernetes-int-or-string"):
        return "integer or string"
    return str(schema.get("type", "any"))


def _default(schema: dict[str, Any]) -> str:
    return f"`{json.dumps(schema['default'])}`" if "default" in schema else ""


def _meaning(schema: dict[str, Any]) -> str:
    bounds = "; ".join(_bounds(schema))
    text = schema.get("description", "").strip()
    shown = f"{_SENTENCE.split(text)[0]} More below." if _is_long(schema) else text
    return escaped(shown) + (f" ({bounds})" if bounds else "")


def _is_long(schema: dict[str, Any]) -> bool:
    return len(schema.get("description", "")) > LONGEST


def _bounds(schema: dict[str, Any]) -> Iterator[str]:
    for unit, least, most in _BOUNDS:
        words = [f"{word} {schema[name]}" for word, name in (("at least", least), ("at most", most)) if name in schema]
        if words:
            yield " and ".join(words) + unit
