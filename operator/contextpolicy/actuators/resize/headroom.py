"""Which limits may be set now, so that the limits of a node sum to no more than its capacity. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True)
class Holding:
    """One container's limit: `spec` is what the API has, `peak` the most that may be in force or on its way.

    `before` is what it had when the plan came, and `stuck` says that the API or the kubelet won't lower it for now.
    """

    id: str
    spec: int
    peak: int
    wanted: int
    before: int = 0
    stuck: bool = False


def strict(capacity: int, holdings: Iterable[Holding]) -> set[str]:
    """The containers whose wanted limit may be set now: all but the increases that don't fit beside what still holds.

    Increases go smallest first, so that the most tasks get their share soonest. What does not fit waits until a
    decrease is in force, and is asked for again then. Going back up to a peak that was not seen to have passed takes no
    more room, but while the peaks sum above the capacity it would keep them there.
    """
    holdings = list(holdings)
    used = sum(holding.peak for holding in holdings)
    rises = [(max(0, h.wanted - h.peak), h.id) for h in holdings if h.wanted > h.spec]
    return {holding.id for holding in holdings if holding.wanted <= holding.spec} | _fitting(capacity - used, rises)


def prompt(capacity: int, holdings: Iterable[Holding]) -> tuple[set[str], set[str]]:
    """The containers whose wanted limit may be set now, and those that have to go back to what they had before.

    Every decrease counts as done when it is asked for. Only where one is stuck, the increases that it was to pay for
    wait, or are taken back: so the sum is above the capacity for no longer than one resize.
    """
    holdings = list(holdings)
    rising = [holding for holding in holdings if holding.wanted > holding.before]
    used = sum(h.before for h in rising) + sum(h.peak if h.stuck else h.wanted for h in holdings if h not in rising)
    go = {holding.id for holding in holdings if holding not in rising}
    go |= _fitting(capacity - used, [(holding.wanted - holding.before, holding.id) for holding in rising])
    return go, {holding.id for holding in rising if holding.id not in go and holding.spec > holding.before}


def _fitting(room: int, rises: Sequence[tuple[int, str]]) -> set[str]:
    found = set()
    for extra, identity in sorted(rises):
        if extra <= room:
            room -= extra
            found.add(identity)
    return found
