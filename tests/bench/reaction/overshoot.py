"""How far, and for how long, the limits of a node sum above what there is to divide. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Mapping

    Task = TypeVar("Task", bound=Hashable)

EXACT = 1e-6


class Overshoot(NamedTuple):
    """Of a transition: cores at the most, seconds above, and the integral in core seconds."""

    height: float
    duration: float
    integral: float


def overshoot(capacity: float, before: Mapping[Task, float], steps: Iterable[tuple[float, Task, float]]) -> Overshoot:
    """What `steps` (time, task, its new limit; in cores and seconds, in order) do to the sum of the limits `before`."""
    limits, since = dict(before), 0.0
    excess = _excess(limits.values(), capacity)
    height = duration = integral = 0.0
    for at, task, limit in steps:
        duration += (at - since) * (excess > 0)
        integral += (at - since) * excess
        limits[task], since = limit, at
        excess = _excess(limits.values(), capacity)
        height = max(height, excess)
    return Overshoot(height, duration, integral)


def _excess(limits: Iterable[float], capacity: float) -> float:
    excess = sum(limits) - capacity
    return excess if excess > EXACT else 0.0
