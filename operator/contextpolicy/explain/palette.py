"""One colour per task and one per context, by name: the same on the live page, in pictures and in Foxglove. Pure.

A colour depends on the name, not on the order, so it stays when other names come and go, unless one of them asks for
the same. Two names of a policy share one only where there are more names than colours.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

MODULE_COLORS: Mapping[str, str] = MappingProxyType(
    {
        "slam": "#1a7ef6",
        "speech": "#e24c7e",
        "signs": "#882ea6",
        "navigation": "#10bac4",
        "imu": "#bab010",
        "arm": "#9c7410",
        "lidar": "#106010",
    }
)
"""Of the tasks in `modules/`: far apart in OKLab, also for eyes that take red for green."""
TASK_COLORS = (
    *MODULE_COLORS.values(),
    *("#2a6f97", "#e07a3f", "#5b8e55", "#8d5b8c", "#f67eec", "#a61010", "#88a6f6", "#5638ba", "#6a4c10"),
    *("#1ac456", "#ce9cb0", "#9c6aec", "#a61074", "#c44cba", "#9cb088", "#a66056", "#7e88b0"),
)
"""As far apart as possible in OKLab among those that stand out from a white and from a black ground (2:1 at least)."""
CONTEXT_COLORS = ("#eca5a4", "#8ecba3", "#b9b2ee", "#e1b080", "#74cbd0", "#dda6d0", "#bdc07f", "#8cc1ee")
"""Lighter than any task's, all alike: a context has its name beside its lane."""


def task_colors(names: Iterable[str]) -> dict[str, str]:
    """The colour of each of a policy's tasks; where two names ask for the same one, the later name takes the next."""
    unique = set(names)
    known = {name: MODULE_COLORS[name] for name in unique & MODULE_COLORS.keys()}
    count = len(MODULE_COLORS)
    return _colors(unique - known.keys(), TASK_COLORS[count:], TASK_COLORS[:count], known)


def context_colors(names: Iterable[str]) -> dict[str, str]:
    """The colour of each context, in the same way."""
    return _colors(set(names), CONTEXT_COLORS, (), {})


def _colors(names: set[str], usual: Sequence[str], spare: Sequence[str], known: Mapping[str, str]) -> dict[str, str]:
    taken = dict(known)
    for name in sorted(names):
        place = _hash(name) % len(usual)
        wanted = [*usual[place:], *usual[:place], *spare]
        taken[name] = next((color for color in wanted if color not in taken.values()), wanted[0])
    return taken


def _hash(name: str) -> int:
    """FNV-1a: Python's own differs from run to run."""
    number = 0x811C9DC5
    for byte in name.encode():
        number = (number ^ byte) * 0x01000193 & 0xFFFFFFFF
    return number
