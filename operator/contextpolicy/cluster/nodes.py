"""A node as the operator sees it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

_CPU = re.compile(r"(?P<whole>[0-9]+)(\.(?P<part>[0-9]+))?(?P<unit>[num]?)")
_PER_MILLI = {"": 1, "m": 10**3, "u": 10**6, "n": 10**9}


def allocatable(node: Mapping[str, Any]) -> int | None:
    """The CPU that a node's pods may use in thousandths of a core, rounded down; None while the kubelet tells none."""
    told = ((node.get("status") or {}).get("allocatable") or {}).get("cpu")
    match = _CPU.fullmatch(str(told))
    if match is None:
        return None
    part = (match["part"] or "").ljust(3, "0")[:3]
    return int(match["whole"] + part) // _PER_MILLI[match["unit"]]
