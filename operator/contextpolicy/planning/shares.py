"""Eq. 1 and Eq. 2: what a weight buys, in whole units, within bounds (paper IV-D).

s_c = N * w_c / sum(w) and t_c = P * w_c / sum(w) are the same division: N (or P) is a number of units, a unit being the
smallest step that the kernel and the kubelet agree on (10m of CFS quota, 1 ms of a realtime second).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.errors import ShareError

if TYPE_CHECKING:
    from collections.abc import Sequence

RESOLUTION = 10**9
"""Weights are rounded to 1 in 10^9 of the heaviest and divided as integers: float noise can't move a unit."""


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
    needed = sum(claim.least for claim in claims)
    if total < needed:
        raise ShareError(f"{total} units cannot be divided over {len(claims)} tasks: they need {needed}")
    if not claims:
        return {}
    if floors_exceed(total, claims):
        return _scaled_floors(total, claims)
    weights = _whole_weights(claims)
    fixed = _clamped(total, claims, weights)
    free = sorted((c for c in claims if c.name not in fixed), key=lambda c: c.name)
    return fixed | _largest_remainder(total - sum(fixed.values()), free, weights)


def floors_exceed(total: int, claims: Sequence[Demand]) -> bool:
    """Whether the floors alone are more than there is to divide."""
    return sum(claim.floor for claim in claims) > total


def _whole_weights(claims: Sequence[Demand]) -> dict[str, int]:
    heaviest = max(claim.weight for claim in claims)
    return {
        claim.name: max(1, round(claim.weight / heaviest * RESOLUTION)) if claim.weight > 0 else 0 for claim in claims
    }


def _clamped(total: int, claims: Sequence[Demand], weights: dict[str, int]) -> dict[str, int]:
    """The claims held at a bound, with their units.

    Water filling: in each round either the claims below their floor or those above their ceiling leave, whichever
    violations sum to more; those would persist in every later round, so each claim leaves at most once.
    """
    fixed = {c.name: c.floor for c in claims if c.weight <= 0 or c.floor == c.ceiling}
    free = [c for c in claims if c.name not in fixed]
    while True:
        left, weight = total - sum(fixed.values()), sum(weights[c.name] for c in free)
        low, high, missing, excess = [], [], 0, 0
        for claim in free:
            part = left * weights[claim.name]
            if part < claim.floor * weight:
                low.append(claim)
                missing += claim.floor * weight - part
            elif part > claim.ceiling * weight:
                high.append(claim)
                excess += part - claim.ceiling * weight
        if not low and not high:
            return fixed
        if missing >= excess:
            fixed |= {claim.name: claim.floor for claim in low}
        if excess >= missing:
            fixed |= {claim.name: claim.ceiling for claim in high}
        free = [claim for claim in free if claim.name not in fixed]


def _largest_remainder(total: int, claims: Sequence[Demand], weights: dict[str, int]) -> dict[str, int]:
    weight = sum(weights[claim.name] for claim in claims)
    if weight == 0:
        return {}
    parts = {c.name: divmod(total * weights[c.name], weight) for c in claims}
    order = sorted(claims, key=lambda c: (-parts[c.name][1], -weights[c.name], c.name))
    extra = {claim.name for claim in order[: total - sum(whole for whole, _ in parts.values())]}
    return {c.name: parts[c.name][0] + (c.name in extra) for c in claims}


def _scaled_floors(total: int, claims: Sequence[Demand]) -> dict[str, int]:
    """Floors that together exceed the total, scaled down: each its `least`, the rest in proportion to the floors."""
    by_floor = [Demand(c.name, float(c.floor), c.least, max(c.least, c.floor), c.least) for c in claims]
    # Recurses once only: the floors are the `least`s now, and `divide` has checked that those fit.
    return divide(total, by_floor)
