"""Kubernetes label selectors, evaluated without Kubernetes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

LABEL_KEY_ALLOWED = "a label key: letters, digits, '-', '_' and '.', at most 63, after a DNS name and '/' if need be"
LABEL_VALUE_ALLOWED = "a label value: letters, digits, '-', '_' and '.', at most 63, a letter or digit at either end"
_WORD = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?")
_PREFIX = re.compile(r"(?=.{1,253}$)[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*")

OPERATORS = ("In", "NotIn", "Exists", "DoesNotExist")


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


@dataclass(frozen=True, slots=True)
class Selector:
    """All requirements must match; `matchLabels` are In-requirements with one value."""

    requirements: tuple[SelectorRequirement, ...]

    def matches(self, labels: Mapping[str, str]) -> bool:
        """Whether a pod with these labels is selected."""
        return all(requirement.matches(labels) for requirement in self.requirements)


def is_label_key(key: str) -> bool:
    """Whether Kubernetes accepts it as a label key."""
    prefix, slash, word = key.rpartition("/")
    return _WORD.fullmatch(word) is not None and (not slash or _PREFIX.fullmatch(prefix) is not None)


def is_label_value(value: str) -> bool:
    """Whether Kubernetes accepts it as a label value; it may be empty."""
    return value == "" or _WORD.fullmatch(value) is not None
