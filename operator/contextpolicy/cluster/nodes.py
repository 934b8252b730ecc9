"""A node as the operator sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kubernetes.utils.quantity import parse_quantity

if TYPE_CHECKING:
    from collections.abc import Mapping


def allocatable(node: Mapping[str, Any]) -> int | None:
    """The CPU that a node's pods may use, in thousandths of a core, rounded down; None until the kubelet reports it."""
    told = ((node.get("status") or {}).get("allocatable") or {}).get("cpu")
    try:
        return int(parse_quantity(told) * 1000)  # type: ignore[no-untyped-call]
    except (ValueError, ArithmeticError):
        return None
