"""Every field of the resource is in a policy that people can read: the cookbook's, or a small example beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
import yaml

from contextpolicy.policy.validation.check import check
from tests.crds.schema import ROOT, schema

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

EXAMPLES = sorted((ROOT / "config" / "examples").glob("*.yaml"))
COOKBOOK = sorted((ROOT / "config" / "policies").glob("*.yaml"))


def fields(node: Mapping[str, Any], path: str = "spec") -> Iterator[str]:
    """Every named field below a schema."""
    for name, child in node.get("properties", {}).items():
        yield f"{path}.{name}"
        yield from fields(child, f"{path}.{name}")
    yield from fields(node["items"], path) if "items" in node else ()
    yield from fields(node["additionalProperties"], path) if "additionalProperties" in node else ()


def used(value: Any, node: Mapping[str, Any], path: str = "spec") -> Iterator[str]:
    """The fields of a schema that a value has."""
    for item in value if isinstance(value, list) else ():
        yield from used(item, node.get("items", {}), path)
    for name, inner in value.items() if isinstance(value, dict) else ():
        if name in node.get("properties", {}):
            yield f"{path}.{name}"
            yield from used(inner, node["properties"][name], f"{path}.{name}")
        else:
            yield from used(inner, node.get("additionalProperties", {}), path)


def test_every_field_is_in_the_cookbook_or_an_example():
    spec = schema()["properties"]["spec"]
    bodies = [yaml.safe_load(path.read_text(encoding="utf-8")) for path in (*COOKBOOK, *EXAMPLES)]
    found = {field for body in bodies for field in used(body["spec"], spec)}
    assert [field for field in fields(spec) if field not in found] == []


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_valid(path):
    assert check([(path.name, path.read_text(encoding="utf-8"))]).errors == []
