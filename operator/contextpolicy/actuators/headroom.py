"""Which limits may be raised now, so that the limits of a node never sum above its capacity. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


@dataclass(frozen=True, slots=True)
class Holding:
    """One container's limit: `now` is the most that may be in force or on its way, `wanted` what the plan says."""

    id: str
    now: int
    wanted: int


def allowed(capacity: int, holdings: Iterable[Holding]) -> Mapping[str, int]:
    """The limits that may be set now, by container: every decrease, and the increases that fit beside what still holds.

    Increases go smallest first, so that the most tasks get their share soonest. What does not fit waits until a
    decrease is in force, and is asked for again then.
    """
    holdings = list(holdings)
    steps = {h.id: h.wanted for h in holdings if h.wanted < h.now}
    used = sum(holding.now for holding in holdings)
    for holding in sorted((h for h in holdings if h.wanted > h.now), key=lambda h: (h.wanted - h.now, h.id)):
        if used + holding.wanted - holding.now <= capacity:
            used += holding.wanted - holding.now
            steps[holding.id] = holding.wanted
    return steps
