"""One colour per task name, the same on the live page, in pictures and in Foxglove. Pure.

The colour depends on the name, not on the order of the tasks, so a task keeps it when others come and go, unless one of
them asks for the same. Two tasks of a policy share one only where there are more tasks than colours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

TASK_COLORS = (
    *("#2a6f97", "#e07a3f", "#5b8e55", "#8d5b8c", "#f67eec", "#a61010", "#88a6f6", "#5638ba"),
    *("#6a4c10", "#bab010", "#e24c7e", "#1ac456", "#10bac4", "#ce9cb0", "#9c6aec", "#1a7ef6"),
    *("#106010", "#a61074", "#c44cba", "#9c7410", "#9cb088", "#882ea6", "#a66056", "#7e88b0"),
)
"""As far apart as possible in OKLab among those that stand out from a white and from a black ground (2:1 at least)."""


def task_colors(names: Iterable[str]) -> dict[str, str]:
    """The colour of each of a policy's tasks; where two names ask for the same one, the later name takes the next."""
    taken: dict[str, str] = {}
    for name in sorted(set(names)):
        free = [color for color in _from(_hash(name)) if color not in taken.values()] or _from(_hash(name))
        taken[name] = free[0]
    return taken


def _from(number: int) -> list[str]:
    place = number % len(TASK_COLORS)
    return [*TASK_COLORS[place:], *TASK_COLORS[:place]]


def _hash(name: str) -> int:
    """FNV-1a: Python's own differs from run to run."""
    number = 0x811C9DC5
    for byte in name.encode():
        number = (number ^ byte) * 0x01000193 & 0xFFFFFFFF
    return number
