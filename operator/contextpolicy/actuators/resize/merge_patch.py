"""Merge patches (RFC 7386) for an object whose current content is uncertain. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

UNSURE = object()
"""In place of a value that the object may or may not hold, or may hold with another content."""


def merge_patch(wanted: Mapping[str, Any], held: Mapping[str, Any]) -> dict[str, Any]:
    """The patch that makes `wanted` of `held`, whatever there is where that is `UNSURE`."""
    patch: dict[str, Any] = dict.fromkeys(held.keys() - wanted.keys())
    for key, want in wanted.items():
        has = held.get(key)
        if isinstance(want, dict):
            inside = merge_patch(want, has if isinstance(has, dict) else {})
            if inside or not isinstance(has, dict):
                patch[key] = inside
        elif has != want:
            patch[key] = want
    return patch


def either(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """What is certain of an object that holds one of the two."""
    return {key: _either(one.get(key), other.get(key)) for key in one.keys() | other.keys()}


def _either(one: object, other: object) -> object:
    if isinstance(one, dict) and isinstance(other, dict):
        return either(one, other)
    if isinstance(one, dict) or isinstance(other, dict):
        return either(one if isinstance(one, dict) else {}, other if isinstance(other, dict) else {}) or UNSURE
    return one if one == other else UNSURE
