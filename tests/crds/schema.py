"""Walking the definition's schema, and reading it as JSON Schema."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
DEFINITION = ROOT / "crds" / "contextpolicies.contextpolicy.dev.yaml"
POLICIES = sorted(p for p in (ROOT / "config" / "policies").glob("*.yaml"))
REFUSED = sorted((ROOT / "tests" / "e2e" / "bad_policies").glob("*.yaml"))


@cache
def definition():
    return yaml.safe_load(DEFINITION.read_text(encoding="utf-8"))


def schema():
    """The openAPIV3Schema of the one version."""
    (version,) = definition()["spec"]["versions"]
    return version["schema"]["openAPIV3Schema"]


def nodes(node, path=""):
    """Every schema below `node` with its path, itself included; the object's own metadata is the API server's."""
    yield path, node
    for name, child in node.get("properties", {}).items():
        if path or name != "metadata":
            yield from nodes(child, f"{path}.{name}".lstrip("."))
    if "items" in node:
        yield from nodes(node["items"], f"{path}[]")
    if "additionalProperties" in node:
        yield from nodes(node["additionalProperties"], f"{path}.*")


def strict(node):
    """As JSON Schema that also refuses unknown fields, which the API server prunes with a warning."""
    result = copy.deepcopy(node)
    for path, child in list(nodes(result)):
        if path and "properties" in child:
            child["additionalProperties"] = False
    return result


def with_defaults(node, value):
    """The value as the API server stores it."""
    if isinstance(value, list):
        return [with_defaults(node.get("items", {}), item) for item in value]
    if not isinstance(value, dict):
        return value
    known = node.get("properties", {})
    filled = {name: child["default"] for name, child in known.items() if "default" in child} | value
    anything = node.get("additionalProperties", {})
    return {name: with_defaults(known.get(name, anything), child) for name, child in filled.items()}
