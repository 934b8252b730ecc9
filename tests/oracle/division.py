"""Eq. 1 within bounds, exactly: one level of water, found between the points at which a task meets a bound."""

from __future__ import annotations

from fractions import Fraction
from math import floor
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.oracle.units import millicores

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.oracle.weighing import Weights

STEP = 10
"""Thousandths of a core in which shares move."""


class Shares(NamedTuple):
    """In thousandths of a core, by task in a container; and those that are to do nothing."""

    of: Mapping[str, int]
    suspended: frozenset[str]


class Claim(NamedTuple):
    """A task's weight and bounds, in steps."""

    weight: Fraction
    least: int
    most: int


def divide(
    spec: Mapping[str, Any],
    weights: Weights,
    at_rest: Weights,
    contexts: Sequence[Mapping[str, Any]],
    cores: int,
) -> Shares:
    """All tasks on one node; if nothing on it is active, by `at_rest`."""
    leaves = [task for task in spec["tasks"] if not task.get("subtasks")]
    rests = not any(weights.value[task["name"]] for task in leaves)
    by = at_rest if rests else weights
    total = (cores * 1000 - millicores(spec.get("reserve", 0))) // STEP
    claims = {task["name"]: _claim(task, by.value[task["name"]], contexts, total) for task in leaves}
    suspended = frozenset(
        task["name"]
        for task in leaves
        if not by.value[task["name"]] and not (task.get("protected") and task["name"] not in weights.unable)
    )
    return Shares({name: units * STEP for name, units in fill(total, claims).items()}, suspended)


def _claim(task: Mapping[str, Any], weight: Fraction, contexts: Sequence[Mapping[str, Any]], total: int) -> Claim:
    kept = max(1, -(-millicores(task.get("suspendedCpu", "10m")) // STEP))
    least = max(kept, -(-millicores(task.get("min", "10m")) // STEP))
    most = millicores(task["max"]) // STEP if "max" in task else total
    for context in contexts:
        effect = context.get("tasks", {}).get(task["name"], {})
        if "min" in effect:
            least = max(kept, millicores(effect["min"]) // STEP)
            most = max(most, least)
        if "max" in effect:
            most = millicores(effect["max"]) // STEP
            least = min(least, most)
    if not weight:
        floor = least if task.get("protected") else kept
        return Claim(weight, floor, floor)
    return Claim(weight, least, max(least, most))


def fill(total: int, claims: Mapping[str, Claim]) -> dict[str, int]:
    """Whole units: each weight times one level, within its bounds, so that they sum to the total if they can."""
    level = _level(total, claims)
    exact = {name: _part(level, claim) for name, claim in claims.items()}
    units = {name: floor(part) for name, part in exact.items()}
    missing = min(total, sum(claim.most for claim in claims.values())) - sum(units.values())
    free = [name for name in claims if exact[name] > units[name]]
    free.sort(key=lambda name: (units[name] - exact[name], -claims[name].weight, name))
    for name in free[: max(0, missing)]:
        units[name] += 1
    return units


def _level(total: int, claims: Mapping[str, Claim]) -> Fraction:
    """Where the sum meets the total; it grows with the level, in straight lines between bounds."""
    bounds = sorted({Fraction(b) / c.weight for c in claims.values() if c.weight for b in (c.least, c.most)})
    low = Fraction(0)
    for high in bounds:
        if _sum(high, claims) >= total:
            grown, needed = _sum(high, claims) - _sum(low, claims), total - _sum(low, claims)
            return low + (high - low) * needed / grown if grown else low
        low = high
    return low


def _sum(level: Fraction, claims: Mapping[str, Claim]) -> Fraction:
    return sum((_part(level, claim) for claim in claims.values()), Fraction(0))


def _part(level: Fraction, claim: Claim) -> Fraction:
    return min(max(claim.weight * level, Fraction(claim.least)), Fraction(claim.most))
