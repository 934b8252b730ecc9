"""The chart's values: each is explained where it stands, bounded by the schema and listed in the reference."""

from __future__ import annotations

import json
import re

import pytest
import yaml
from jsonschema import Draft202012Validator

from tests.charts.conftest import CHART

TEXT = (CHART / "values.yaml").read_text(encoding="utf-8")
REFERENCE = (CHART.parents[1] / "docs" / "reference" / "chart.md").read_text(encoding="utf-8")
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
    assert f"| `{'.'.join(path)}` | `{json.dumps(value)}` |" in REFERENCE


def is_in_schema(path):
    node = SCHEMA
    for name in path:
        node = node["properties"].get(name, {})
    return bool(node)


def is_explained(name):
    """A comment stands above every key of that name."""
    keys = re.findall(rf"^(.*)\n *{name}:", "\n" + TEXT, flags=re.MULTILINE)
    return bool(keys) and all(above.lstrip().startswith("#") for above in keys)


def test_schema_rejects_unknown_values():
    assert [path for path, schema in named_objects(SCHEMA) if schema.get("additionalProperties") is not False] == []


RULES = SCHEMA["properties"]["metrics"]["properties"]["alerts"]["properties"]["rules"]["properties"]
DURATIONS = {name: rule["properties"]["for"] for name, rule in RULES.items()} | {
    "interval": SCHEMA["properties"]["metrics"]["properties"]["podMonitor"]["properties"]["interval"]
}


@pytest.mark.parametrize("name", DURATIONS)
def test_schema_accepts_prometheus_durations_only(name):
    """Its operator refuses others only after the installation, in a log."""
    takes = Draft202012Validator(DURATIONS[name]).is_valid
    assert all(map(takes, ("15s", "1m30s", "500ms", "2h", "1d", "1w2d3h4m5s6ms", "1y")))
    wrong = ("", "5", "1m1h", "1m1m", "5ms5s", "1.5m", "-5m", "5 m", "5min", "m", 15)
    assert [one for one in wrong if takes(one)] == []
    assert (takes("0"), takes("0s")) == (name != "interval",) * 2, (
        "a rule may fire at once; nobody scrapes all the time"
    )
