"""Eq. 1 and Eq. 2: what a weight buys, in whole units, within bounds (paper IV-D).

s_c = N * w_c / sum(w) and t_c = P * w_c / sum(w) are the same division: N (or P) is a number of units, a unit being the
smallest step that the kernel and the kubelet agree on (10m of CFS quota, a thousandth of each processor's realtime
period).
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from contextpolicy.errors import ShareError

if TYPE_CHECKING:
    from collections.abc import Sequence

RESOLUTION = 10**9
"""Weights are rounded to 1 in 10^9 of the heaviest and divided as integers: float noise can't move a unit. Nor can the
rounding: remainders that it may have parted are equal."""


_Remainder: TypeAlias = tuple[int, int, str, int]
"""Of one claim in a division: its remainder and its weight, both negated, its name and its place."""
_REMAINDER, _WEIGHT_AND_NAME = itemgetter(0), itemgetter(1, 2)


class Demand(NamedTuple):
    """One task's part in the division: weight and bounds in units, `floor <= ceiling`.

    A claim of weight 0 gets its floor, no more. `least` is what it gets even where floors are scaled down.
    """

    name: str
    weight: float
    floor: int
    ceiling: int
    least: int = 1


def divide(total: int, claims: Sequence[Demand]) -> dict[str, int]:
    """Units per claim, by weight, within [floor, ceiling]; the sum is min(total, sum of ceilings) exactly.

    Bounds are met by redistribution: a claim held at a bound leaves the division and the others share the rest, as
    in weighted max-min fairness. Fractions are settled by largest remainder; ties go to the heavier, then by name.
    Floors above the total (see `floors_exceed`) are scaled down in proportion, with no claim below its `least`.
    ShareError when the total is less than the sum of `least`.
    """
    if not claims:
        return {}
    names, weights, floors, ceilings, leasts = zip(*claims, strict=True)
    if total < sum(leasts):
        raise ShareError(f"{total} units cannot be divided over {len(claims)} tasks: they need {sum(leasts)}")
    if sum(floors) > total:
        return _scaled_floors(total, claims)
    division = _Division(total, names, _whole(weights), floors, ceilings)
    division.clamp()
    division.settle()
    return dict(zip(names, division.units, strict=True))


def floors_exceed(total: int, claims: Sequence[Demand]) -> bool:
    """Whether the floors alone are more than there is to divide."""
    return sum([claim.floor for claim in claims]) > total


def _whole(weights: Sequence[float]) -> list[int]:
    heaviest = max(weights)
    return [round(weight / heaviest * RESOLUTION) or 1 if weight > 0 else 0 for weight in weights]


class _Division:
    """One division under way, in columns with a place for each claim.

    It is rebuilt with nearly every plan, so it sums lists: for 20 claims that is quicker than generators.
    """

    def __init__(
        self, total: int, names: Sequence[str], weights: list[int], floors: Sequence[int], ceilings: Sequence[int]
    ) -> None:
        self._names, self._weights, self._floors, self._ceilings = names, weights, floors, ceilings
        self.units = list(floors)
        """What each claim gets; of a free one its floor until it is settled."""
        self._free = [place for place, weight in enumerate(weights) if weight > 0 and floors[place] != ceilings[place]]
        self._left = total - sum(floors) + sum([floors[place] for place in self._free])
        """What is left for the free claims."""

    def clamp(self) -> None:
        """Hold the claims whose part is out of bounds at that bound.

        Water filling: in each round either the claims below their floor or those above their ceiling leave, whichever
        violations sum to more; those would persist in every later round, so each claim leaves at most once.
        """
        floors, ceilings, weights = self._floors, self._ceilings, self._weights
        while True:
            left, weight = self._left, sum([weights[place] for place in self._free])
            low, high, missing, excess = [], [], 0, 0
            for place in self._free:
                part = left * weights[place]
                if part < floors[place] * weight:
                    low.append(place)
                    missing += floors[place] * weight - part
                elif part > ceilings[place] * weight:
                    high.append(place)
                    excess += part - ceilings[place] * weight
            if not low and not high:
                return
            if missing >= excess:
                self._hold(low, floors)
            if excess >= missing:
                self._hold(high, ceilings)

    def _hold(self, places: Sequence[int], bounds: Sequence[int]) -> None:
        for place in places:
            self.units[place] = bounds[place]
            self._left -= bounds[place]
        self._free = [place for place in self._free if place not in places]

    def settle(self) -> None:
        """Divide what is left over the free claims, by largest remainder."""
        names, weights, units, total = self._names, self._weights, self.units, self._left
        weight = sum([weights[place] for place in self._free])
        order: list[_Remainder] = []
        left = total
        for place in self._free:
            units[place], remainder = divmod(total * weights[place], weight)
            left -= units[place]
            order.append((-remainder, -weights[place], names[place], place))
        order.sort()
        noise = total * len(order)  # rounding moves each weight by half at most
        if 0 < left < len(order) and order[left][0] - order[left - 1][0] <= noise:
            _settle_ties(order, order[left - 1][0], noise)
        for *_, place in order[:left]:
            units[place] += 1


def _settle_ties(order: list[_Remainder], last: int, noise: int) -> None:
    """Sort those by weight whose remainders only rounding may have parted from the last that gets a unit."""
    start = bisect_left(order, last - noise, key=_REMAINDER)
    end = bisect_right(order, last + noise, key=_REMAINDER)
    order[start:end] = sorted(order[start:end], key=_WEIGHT_AND_NAME)


def _scaled_floors(total: int, claims: Sequence[Demand]) -> dict[str, int]:
    """Floors that together exceed the total, scaled down: each its `least`, the rest in proportion to the floors."""
    by_floor = [Demand(c.name, float(c.floor), c.least, max(c.least, c.floor), c.least) for c in claims]
    # Recurses once only: the floors are the `least`s now, and `divide` has checked that those fit.
    return divide(total, by_floor)
