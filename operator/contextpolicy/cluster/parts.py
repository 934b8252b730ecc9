"""How namespaces that meet as equals divide a node: in proportion to requests, as the kernel does without us. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class Stake(NamedTuple):
    """What the containers of a namespace request of a node and may use of it at most, in thousandths of a core.

    Both are what they had before any policy: requests are room that the scheduler has kept for them, and limits anybody
    may write.
    """

    request: int = 0
    limit: int = 0

    def __add__(self, other: object) -> Stake:
        """Both together."""
        if not isinstance(other, Stake):
            return NotImplemented
        return Stake(self.request + other.request, self.limit + other.limit)


def parts(total: int, stakes: Mapping[str, Stake]) -> dict[str, int]:
    """What each gets of `total`: in proportion to requests, up to its limits; what those leave goes to the others.

    If the requests fit together, nobody gets less than its own; and nobody gets less because of another one's limits.
    """
    found: dict[str, int] = {}
    left, weight = total, sum(_weight(stake) for stake in stakes.values())
    for name, stake in sorted(stakes.items(), key=lambda item: (item[1].limit / _weight(item[1]), item[0])):
        found[name] = min(stake.limit, left * _weight(stake) // weight)
        left, weight = left - found[name], weight - _weight(stake)
    return found


def _weight(stake: Stake) -> int:
    """The kernel also gives time to containers that request nothing."""
    return max(1, stake.request)
