"""Which limits may be set now without the sum of a node's limits exceeding its capacity. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True)
class Holding:
    """One container's limit: `spec` is what the API has, `peak` the most that may be in force or on its way.

    `before` is what it had when the plan came; `stuck` if the API or the kubelet won't lower it for now. Amounts are
    thousandths of a core.
    """

    id: str
    spec: int
    peak: int
    wanted: int
    before: int = 0
    stuck: bool = False


def strict(capacity: int, holdings: Iterable[Holding]) -> set[str]:
    """The containers whose wanted limit may be set now: all but the increases that don't fit beside the peaks.

    The smallest increases go first, so that most tasks get their share soonest. The others wait until a decrease is in
    force. An increase up to the container's own peak needs no room, but while the peaks exceed the capacity it waits
    too: it would keep them there.
    """
    holdings = list(holdings)
    used = sum(holding.peak for holding in holdings)
    rises = [(max(0, h.wanted - h.peak), h.id) for h in holdings if h.wanted > h.spec]
    return {holding.id for holding in holdings if holding.wanted <= holding.spec} | _fitting(capacity - used, rises)


def prompt(capacity: int, holdings: Iterable[Holding]) -> tuple[set[str], set[str]]:
    """The containers whose wanted limit may be set now, and those that must go back to what they had before.

    A decrease counts as done as soon as it is requested. Only when one is stuck do the increases that it should have
    paid for wait, or get reverted: so the sum exceeds the capacity for one resize at most.
    """
    holdings = list(holdings)
    rising = [holding for holding in holdings if holding.wanted > holding.before]
    others = [holding for holding in holdings if holding.wanted <= holding.before]
    used = sum([h.before for h in rising]) + sum([h.peak if h.stuck else h.wanted for h in others])
    go = {holding.id for holding in others}
    go |= _fitting(capacity - used, [(holding.wanted - holding.before, holding.id) for holding in rising])
    return go, {holding.id for holding in rising if holding.id not in go and holding.spec > holding.before}


def _fitting(room: int, rises: Sequence[tuple[int, str]]) -> set[str]:
    found = set()
    for extra, identity in sorted(rises):
        if extra <= room:
            room -= extra
            found.add(identity)
    return found
