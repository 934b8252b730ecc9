"""Which limits may be set now, so that the limits of a node never sum above its capacity. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True)
class Holding:
    """One container's limit: `spec` is what the API has, `peak` the most that may be in force or on its way."""

    id: str
    spec: int
    peak: int
    wanted: int


def allowed(capacity: int, holdings: Iterable[Holding]) -> set[str]:
    """The containers whose wanted limit may be set now: all but the increases that don't fit beside what still holds.

    Increases go smallest first, so that the most tasks get their share soonest. What does not fit waits until a
    decrease is in force, and is asked for again then. Going back up to a peak that was not seen to have passed takes no
    more room, but while the peaks sum above the capacity it would keep them there.
    """
    holdings = list(holdings)
    steps = {holding.id for holding in holdings if holding.wanted <= holding.spec}
    used = sum(holding.peak for holding in holdings)
    rises = [(max(0, h.wanted - h.peak), h.id) for h in holdings if h.wanted > h.spec]
    for extra, identity in sorted(rises):
        if used + extra <= capacity:
            used += extra
            steps.add(identity)
    return steps
