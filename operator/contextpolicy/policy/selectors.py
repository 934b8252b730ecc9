"""Kubernetes label selectors, read and evaluated without Kubernetes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.policy.fields import Fields

_KEY_ALLOWED = "a label key: letters, digits, '-', '_' and '.', at most 63, after a DNS name and '/' if need be"
_VALUE_ALLOWED = "a label value: letters, digits, '-', '_' and '.', at most 63, a letter or digit at either end"
_WORD = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?")
_PREFIX = re.compile(r"(?=.{1,253}$)[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*")

_OPERATORS = ("In", "NotIn", "Exists", "DoesNotExist")


@dataclass(frozen=True, slots=True)
class SelectorRequirement:
    """One `matchExpressions` entry."""

    key: str
    operator: str
    values: tuple[str, ...] = ()

    def matches(self, labels: Mapping[str, str]) -> bool:
        """As the API server decides; NotIn also matches a missing label."""
        match self.operator:
            case "In":
                return labels.get(self.key) in self.values
            case "NotIn":
                return labels.get(self.key) not in self.values
            case "Exists":
                return self.key in labels
            case _:
                return self.key not in labels

    def __str__(self) -> str:
        """As kubectl takes it."""
        match self.operator:
            case "In" if len(self.values) == 1:
                return f"{self.key}={self.values[0]}"
            case "Exists":
                return self.key
            case "DoesNotExist":
                return f"!{self.key}"
            case _:
                return f"{self.key} {self.operator.lower()} ({','.join(self.values)})"


@dataclass(frozen=True, slots=True)
class Selector:
    """All requirements must match; `matchLabels` are In-requirements with one value."""

    requirements: tuple[SelectorRequirement, ...]

    def matches(self, labels: Mapping[str, str]) -> bool:
        """Whether a pod with these labels is selected."""
        return all(requirement.matches(labels) for requirement in self.requirements)

    def __str__(self) -> str:
        """As kubectl takes it."""
        return ",".join(str(requirement) for requirement in self.requirements)


def read_selector(fields: Fields) -> Selector:
    """The selector that an object's fields are; labels that no pod can have are refused, by Kubernetes' own rules."""
    labels = [SelectorRequirement(key, "In", (value,)) for key, value in fields.string_map("matchLabels").items()]
    for label in labels:
        _check_label(fields, f"matchLabels.{label.key}", label)
    expressions = []
    for item in fields.nested_list("matchExpressions", limit=16):
        operator = item.text("operator", pattern="|".join(_OPERATORS), allowed="one of " + ", ".join(_OPERATORS))
        expressions.append(SelectorRequirement(item.text("key"), operator, item.texts("values", limit=16)))
        _check_label(item, "key", expressions[-1])
        item.close()
    fields.close()
    if fields.is_blank():
        fields.refuse("", {}, "at least one label: an empty selector would claim every pod")
    return Selector((*labels, *expressions))


def _check_label(fields: Fields, name: str, label: SelectorRequirement) -> None:
    if label.key and not _is_key(label.key):
        fields.refuse(name, label.key, _KEY_ALLOWED)
    for value in label.values:
        if not _is_value(value):
            fields.refuse(name, value, _VALUE_ALLOWED)


def _is_key(key: str) -> bool:
    prefix, slash, word = key.rpartition("/")
    return _WORD.fullmatch(word) is not None and (not slash or _PREFIX.fullmatch(prefix) is not None)


def _is_value(value: str) -> bool:
    return value == "" or _WORD.fullmatch(value) is not None
