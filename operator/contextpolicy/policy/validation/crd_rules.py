"""What the API server refuses and planning does not need to know: the resource definition's bounds and formats.

Planning checks everything that it relies on; this is the rest, so that a file that passes here is stored by the API.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import FUNCTIONS
from contextpolicy.policy.quantities import parse_duration
from contextpolicy.policy.references import CEL_WORDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MAX_NUMBER = 1_000_000


class Rule(NamedTuple):
    """What one field may hold; a value of another type is planning's finding already."""

    field: str
    holds: Callable[[Any], bool]
    allowed: str


def findings(body: dict[str, Any]) -> Iterator[Finding]:
    """Everything that breaks a rule, in the order of the rules."""
    for rule in RULES:
        for path, value in _at(body, "", rule.field):
            if value is not None and not rule.holds(value):
                yield Finding(path, value, rule.allowed)
    if isinstance(spec := body.get("spec"), dict) and spec.get("streams") in (None, []):
        yield Finding("spec.streams", spec.get("streams"), "at least one stream")


def _at(value: Any, path: str, pattern: str) -> Iterator[tuple[str, Any]]:
    """Every value that `pattern` selects: `[]` stands for each item, `*` for each key of a map."""
    head, _, rest = pattern.partition(".")
    name = head.removesuffix("[]")
    if not isinstance(value, dict):
        return
    for key in value if name == "*" else [name] if name in value else []:
        inner = f"{path}.{key}" if path else str(key)
        items = enumerate(value[key]) if head.endswith("[]") and isinstance(value[key], list) else ()
        found = [(f"{inner}[{i}]", item) for i, item in items] if head.endswith("[]") else [(inner, value[key])]
        for inner_path, item in found:
            yield from _at(item, inner_path, rest) if rest else [(inner_path, item)]


def _text(pattern: str, longest: int) -> Callable[[Any], bool]:
    compiled = re.compile(pattern)
    return lambda value: not isinstance(value, str) or (len(value) <= longest and bool(compiled.fullmatch(value)))


def _at_most(count: int) -> Callable[[Any], bool]:
    return lambda value: not isinstance(value, dict | list | str) or len(value) <= count


def _is_number(value: Any) -> bool:
    return not isinstance(value, int | float) or value <= MAX_NUMBER


def _is_whole(value: Any) -> bool:
    return not isinstance(value, float) or value.is_integer()


def _is_unique(names: Any) -> bool:
    return not isinstance(names, list) or all(count == 1 for count in Counter(map(repr, names)).values())


def _is_unique_by_name(items: Any) -> bool:
    return not isinstance(items, list) or _is_unique([item.get("name") for item in items if isinstance(item, dict)])


def _is_above_zero(value: Any) -> bool:
    try:
        return parse_duration(value) > 0
    except ValueError:
        return True


def _values_fit(expression: Any) -> bool:
    if not isinstance(expression, dict) or expression.get("operator") not in ("In", "NotIn", "Exists", "DoesNotExist"):
        return True
    return (expression["operator"] in ("In", "NotIn")) == bool(expression.get("values"))


def _with_fits(activity: Any) -> bool:
    return not isinstance(activity, dict) or activity.get("with") is None or activity.get("initiative") is not None


def _is_one_change(effect: Any) -> bool:
    if not isinstance(effect, dict):
        return True
    return len([name for name in ("weight", "scale", "suspend") if effect.get(name) is not None]) == 1


_CHUNK = r"(\*|\*\*|[^/*?#$]+)"
_KEY = rf"(?!.*\*\*/\*){_CHUNK}(/{_CHUNK})*"
_KEY_WORDS = "a Zenoh key expression in canonical form: * or ** as whole chunks, */** and not **/*, none of ? # $"
_DATE = r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)"
_LABEL = r"[a-z0-9]([a-z0-9-]*[a-z0-9])?"
_NUMBER_WORDS = f"at most {MAX_NUMBER}"
_ABOVE_ZERO = "a duration above 0; leave it out for never"

_DURATIONS = (
    *("minDwell", "streams[].staleAfter", "streams[].debounce", "streams[].sampleEvery", "streams[].features[].over"),
    *("tasks[].needs.deadline", "tasks[].activity[].hold", "tasks[].activity[].decay", "tasks[].requires[].hold"),
    *("contexts[].enterAfter", "contexts[].exitAfter"),
)
_CPU = ("reserve", "tasks[].min", "tasks[].max", "tasks[].needs.cores")
_NUMBERS = (
    *("tasks[].priority", "tasks[].idle", "tasks[].activity[].score"),
    *("contexts[].tasks.*.weight", "contexts[].tasks.*.scale"),
)

RULES: tuple[Rule, ...] = (
    Rule("metadata.name", _text(rf"{_LABEL}(\.{_LABEL})*", 253), "a DNS name: lower-case letters, digits, - and ."),
    Rule("metadata.namespace", _text(_LABEL, 63), "a DNS label: lower-case letters, digits and -"),
    *(Rule(f"spec.{field}", _at_most(32), "at most 32 characters") for field in _DURATIONS),
    *(Rule(f"spec.{field}", _is_whole, 'a fraction in quotes ("0.5") or in thousandths (500m)') for field in _CPU),
    *(Rule(f"spec.{field}", _at_most(16), "at most 16 characters") for field in _CPU),
    *(Rule(f"spec.{field}", _is_number, _NUMBER_WORDS) for field in _NUMBERS),
    Rule("spec.force.until", _text(_DATE, 64), "a date and time as in RFC 3339, such as 2026-11-21T12:00:00Z"),
    *(Rule(f"spec.streams[].{field}", _text(_KEY, 256), _KEY_WORDS) for field in ("key", "liveliness")),
    Rule(
        "spec.streams[].type",
        _text(r"[A-Za-z][A-Za-z0-9_]*/msg/[A-Z][A-Za-z0-9]*", 128),
        "a ROS 2 type such as sensor_msgs/msg/Imu",
    ),
    Rule("spec.streams[].staleAfter", _is_above_zero, _ABOVE_ZERO),
    Rule(
        "spec.streams[].timestamp",
        _text(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*", 256),
        "a field path such as header.stamp",
    ),
    Rule("spec.streams[].features", _is_unique_by_name, "each name once"),
    Rule(
        "spec.streams[].features[].name",
        lambda name: not isinstance(name, str) or name not in CEL_WORDS - set(FUNCTIONS) - {"size", "has"},
        "a name that is no word of CEL",
    ),
    Rule(
        "spec.tasks[].needs.memory",
        lambda value: _is_whole(value) and _text(r"[0-9]+(\.[0-9]+)?(k|Ki|M|Mi|G|Gi|T|Ti)?", 24)(value),
        'a memory quantity with a unit of k, M, G, T, Ki, Mi, Gi or Ti, such as "100Mi"',
    ),
    Rule("spec.tasks[].container", _text(_LABEL, 63), "a container name: lower-case letters, digits and -"),
    Rule("spec.tasks[].selector.matchLabels", _at_most(16), "at most 16 labels"),
    Rule("spec.tasks[].selector.matchLabels.*", _at_most(63), "at most 63 characters"),
    Rule("spec.tasks[].selector.matchExpressions[]", _values_fit, "values with In and NotIn, none with the others"),
    Rule("spec.tasks[].selector.matchExpressions[].key", _at_most(317), "at most 317 characters"),
    Rule("spec.tasks[].selector.matchExpressions[].values", _at_most(16), "at most 16 values"),
    Rule("spec.tasks[].selector.matchExpressions[].values[]", _at_most(63), "at most 63 characters"),
    Rule("spec.tasks[].activity[]", _with_fits, "with only beside an initiative, which it configures"),
    Rule("spec.tasks[].activity[].initiative", _text(r"[A-Za-z_][A-Za-z0-9_.-]*", 256), "an entry point's name"),
    Rule("spec.tasks[].activity[].with", _at_most(32), "at most 32 settings"),
    Rule("spec.tasks[].activity[].with.*", _at_most(1024), "at most 1024 characters"),
    Rule("spec.tasks[].subtasks", _is_unique, "each subtask once"),
    Rule("spec.contexts[].tasks.*", _is_one_change, "exactly one of weight, scale and suspend"),
)
