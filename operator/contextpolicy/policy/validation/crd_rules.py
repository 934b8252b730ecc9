"""The resource definition's CEL rules, evaluated offline as the API server evaluates them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.errors import Finding
from contextpolicy.policy import cel_cost, cel_syntax
from contextpolicy.policy.lean_cel import cel
from contextpolicy.policy.quantities import parse_cpu

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping


class Rule(NamedTuple):
    """One rule applied to one object, its `self`; a violation is reported at the field `name`, "" for the object."""

    path: str
    value: Any
    source: str
    name: str
    allowed: str

    @property
    def field(self) -> str:
        """Where a violation is reported."""
        return _inner(self.path, self.name)

    @property
    def found(self) -> Any:
        """What is there; None if nothing is."""
        found = self.value
        for step in filter(None, self.name.split(".")):
            found = found.get(step) if isinstance(found, dict) else None
        return found


def findings(stored: Mapping[str, Any], schema: Mapping[str, Any], reported: Collection[str]) -> Iterator[Finding]:
    """Every rule that does not hold, except those that read a field in `reported`, the paths already reported.

    A rule that can't be evaluated counts as violated, unless something in its object was reported and may be the cause.
    """
    for rule in rules(stored, schema):
        about = [_inner(rule.path, name) for name in _reads(rule.source)]
        if rule.path in reported or any(_is_within(field, read) for field in reported for read in about):
            continue
        try:
            holds = _holds(rule.source, rule.value)
        except (ValueError, TypeError, RuntimeError, ArithmeticError, LookupError):
            holds = any(_is_within(field, rule.path) for field in reported)
        if not holds:
            yield Finding(rule.field, rule.found, rule.allowed)


def rules(value: Any, node: Mapping[str, Any], path: str = "") -> Iterator[Rule]:
    """Every rule of the schema with each object in `value` that it applies to, as far as the schema describes it."""
    if isinstance(value, list):
        # A list that is too long is the schema's finding; its items may be too many to check.
        for index, item in enumerate(value if len(value) <= node.get("maxItems", 0) else ()):
            yield from rules(item, node.get("items", {}), f"{path}[{index}]")
    elif isinstance(value, dict):
        for rule in node.get("x-kubernetes-validations", ()):
            name, allowed = rule.get("fieldPath", "").removeprefix("."), rule["message"].removeprefix("expected ")
            yield Rule(path, value, rule["rule"], name, allowed)
        known, other = node.get("properties", {}), node.get("additionalProperties", {})
        for name, inner in value.items():
            yield from rules(inner, known.get(name, other), _inner(path, name))


def _inner(path: str, name: str) -> str:
    """The path of a field of an object; of the object itself where there is no name."""
    return ".".join(filter(None, (path, name)))


@cache
def _compiled(source: str) -> cel.Program:
    return cel.compile(source)


@cache
def _reads(source: str) -> frozenset[str]:
    return frozenset(path[1] for path in cel_cost.read(cel_syntax.parse(source)).reads if path[0] == "self")


def _holds(source: str, value: Any) -> bool:
    """Whether the rule holds; passes on any exception of the CEL library if it can't be evaluated.

    Kubernetes' own functions are bound by name alone: `sets` is an empty variable, so that `sets.contains(a, b)` is a
    method call.
    """
    context = cel.Context(variables={"self": value, "sets": {}})
    context.add_function("contains", lambda _, whole, part: all(item in whole for item in part))
    context.add_function("quantity", parse_cpu)
    context.add_function("compareTo", lambda one, other: (one > other) - (one < other))
    return bool(_compiled(source).execute(context))


def _is_within(field: str, path: str) -> bool:
    return not path or field == path or field.startswith((f"{path}.", f"{path}["))
