"""The chart's values: each is explained where it stands, bounded by the schema and listed in the README."""

from __future__ import annotations

import json
import re

import pytest
import yaml

from tests.charts.conftest import CHART

TEXT = (CHART / "values.yaml").read_text(encoding="utf-8")
SCHEMA = json.loads((CHART / "values.schema.json").read_text(encoding="utf-8"))


def leaves(node, path=()):
    """Every value with its path; the resources of a container are one value."""
    for name, value in node.items():
        if isinstance(value, dict) and value and name != "resources":
            yield from leaves(value, (*path, name))
        else:
            yield (*path, name), value


def named_objects(schema, path=()):
    """The schemas of all objects with named fields."""
    if "properties" in schema:
        yield path, schema
        for name, child in schema["properties"].items():
            yield from named_objects(child, (*path, name))


VALUES = list(leaves(yaml.safe_load(TEXT)))


@pytest.mark.parametrize(("path", "value"), VALUES, ids=[".".join(path) for path, _ in VALUES])
def test_a_value(path, value):
    assert is_in_schema(path)
    assert is_explained(path[-1])
    assert f"| `{'.'.join(path)}` | `{json.dumps(value)}` |" in (CHART / "README.md").read_text(encoding="utf-8")


def is_in_schema(path):
    node = SCHEMA
    for name in path:
        node = node["properties"].get(name, {})
    return bool(node)


def is_explained(name):
    """A comment stands above every key of that name."""
    keys = re.findall(rf"^(.*)\n *{name}:", "\n" + TEXT, flags=re.MULTILINE)
    return bool(keys) and all(above.lstrip().startswith("#") for above in keys)


def test_the_schema_refuses_what_it_does_not_know():
    assert [path for path, schema in named_objects(SCHEMA) if schema.get("additionalProperties") is not False] == []
