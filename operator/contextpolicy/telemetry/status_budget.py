"""How often a policy's status may be written, by what is new in it. Pure.

A write costs flash: 0.1 MiB on SQLite (kine), half of what a limit that moves costs. What a person should look into is
written at once, what moves with every sample only now and then: the API is not read more often.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

BURST = 15
"""Writes that may come at once, one a second, after a quiet time."""
REFILL = 30.0
"""Seconds until one more may: of contexts that change without end the status is at most so old."""
FOR_CONTEXTS, FOR_CONDITIONS = 10, 5
"""Writes that weights and all that moves with samples leave to contexts, and contexts to conditions."""


def reserve(before: Mapping[str, Any] | None, status: Mapping[str, Any]) -> int:
    """How many writes must be left after that of this status; `before` is the one that was written last."""
    if before is None or _conditions(before) != _conditions(status):
        return 0
    return FOR_CONDITIONS if before.get("contexts") != status.get("contexts") else FOR_CONTEXTS


def _conditions(status: Mapping[str, Any]) -> tuple[Any, ...]:
    """What a person, or the operator's next start, may have to act on."""
    shadow = status.get("shadow") or {}
    known = [(one["type"], one["status"], one["reason"]) for one in status.get("conditions", ())]
    return status.get("observedGeneration"), known, status.get("promotedShadow"), shadow.get("reverted")
