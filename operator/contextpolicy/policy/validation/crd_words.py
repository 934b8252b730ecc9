"""What a field of the resource definition may hold, in words for people instead of schema keywords."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.policy.fields import FEATURE_NAME_ALLOWED, STREAM_NAME_ALLOWED, TASK_NAME_ALLOWED
from contextpolicy.policy.quantities import CPU_ALLOWED, DURATION_ALLOWED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jsonschema import ValidationError

_TYPES = {
    "string": "a string",
    "array": "a list",
    "object": "an object",
    "number": "a number",
    "integer": "an integer",
    "boolean": "true or false",
}

_FRACTION = 'a fraction in quotes ("0.5") or in thousandths (500m)'
"""A CPU quantity is an integer or a string in the API, and a bare 0.5 is neither."""

PATTERNS = {
    r"^[a-z][a-z0-9_]{0,62}$": STREAM_NAME_ALLOWED,
    r"^[a-z][a-z0-9-]{0,62}$": TASK_NAME_ALLOWED,
    r"^[a-z][A-Za-z0-9_]{0,62}$": FEATURE_NAME_ALLOWED,
    r"^[a-z0-9]([a-z0-9-]*[a-z0-9])?$": "lower-case letters, digits and '-', no '-' at either end",
    r"^[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*$": (
        "a DNS name: lower-case letters, digits, '-' and '.'"
    ),
    r"^([0-9]+(\.[0-9]+)?(ms|s|m|h))+$": DURATION_ALLOWED,
    r"^[0-9]+(\.[0-9]{1,3})?$|^[0-9]+m$": CPU_ALLOWED,
    r"^[0-9]+(\.[0-9]+)?(k|Ki|M|Mi|G|Gi|T|Ti)?$": (
        'a memory quantity with a unit of k, M, G, T, Ki, Mi, Gi or Ti, such as "100Mi"'
    ),
    r"^[A-Za-z][A-Za-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$": "a ROS 2 type such as sensor_msgs/msg/Imu",
    r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*$": "a field path such as header.stamp",
    r"^[A-Za-z_][A-Za-z0-9_.-]*$": "an entry point's name: letters, digits, '_', '.' and '-'",
}
"""What each pattern of the definition means; a test fails for one that is missing here."""


def allowed(error: ValidationError, field: str) -> str:  # noqa: PLR0911 - one sentence a keyword
    """What the field may hold instead."""
    node: Mapping[str, Any] = error.schema
    match error.validator:
        case "properties":
            return "one of the fields " + ", ".join(sorted(node["properties"]))
        case "minLength":
            return "a string that is not empty"
        case "maxLength":
            return f"at most {node['maxLength']} characters"
        case "maxItems":
            return f"at most {node['maxItems']} items"
        case "maxProperties":
            return f"at most {node['maxProperties']} entries"
        case "x-kubernetes-list-type":
            return f"each {_singular(field) if error.validator_value == 'set' else 'name'} once"
        case "anyOf" if isinstance(error.instance, float) and kind(node, field) == CPU_ALLOWED:
            return _FRACTION
    return kind(node, field)


def kind(node: Mapping[str, Any], field: str) -> str:
    """What sort of value belongs there."""
    if "enum" in node:
        return "one of " + ", ".join(node["enum"])
    if "pattern" in node:
        return PATTERNS[node["pattern"]]
    if node.get("format") == "date-time":
        return "a date and time as in RFC 3339, such as 2026-11-21T12:00:00Z"
    if node.get("minItems"):
        return f"at least one {_singular(field)}"
    if "maximum" in node:
        return f"a number from {node['minimum']} to {node['maximum']}"
    return _TYPES[str(node["type"])]


def _singular(field: str) -> str:
    return field.rpartition(".")[2].removesuffix("s")
