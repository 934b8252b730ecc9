"""What a robot may write to its SD card, and which of it was met. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class Goal(NamedTuple):
    """A figure of a load, and the most that it may be."""

    load: str
    figure: str
    most: float
    unit: str
    meaning: str


ABOVE = "above_rest_mib_per_hour"
GOALS = (
    Goal("storm_agent", ABOVE, 0.3 * 1024, "MiB an hour above rest", "8 limits a second, with the agent"),
    Goal("minute_agent", ABOVE, 30, "MiB an hour above rest", "contexts once a minute, with the agent"),
    Goal("storm", "own_share_percent", 10, "% of the bytes", "the operator's status and Events, without the agent"),
)
LOADS = ("rest", "storm_agent", "minute_agent", "storm")
"""What the goals need, the soonest wanted first."""


def above(load: Mapping[str, float], rest: Mapping[str, float]) -> float:
    """What a load writes an hour beyond what is written at rest, in MiB."""
    return round(load["datastore_mib_per_hour"] - rest["datastore_mib_per_hour"], 1)


def judged(row: Mapping[str, Any]) -> list[str]:
    """One line for each goal; a load that was not measured is left."""
    return [_line(goal, row.get(goal.load) or {}) for goal in GOALS]


def _line(goal: Goal, load: Mapping[str, float]) -> str:
    seen = load.get(goal.figure)
    if seen is None:
        return f"left    {goal.meaning}"
    verdict = "met   " if seen <= goal.most else "missed"
    return f"{verdict}  {goal.meaning}: {seen:g} {goal.unit}, the goal is {goal.most:g}"
