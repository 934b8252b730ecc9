"""How fast the robot may drive given what the lidar saw."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

from modules.navigation.waypoints import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

RADIUS = 0.174
"""m, of the Create 2; the lidar sits on its axis."""
SIDE_MARGIN = 0.03
STOP_GAP = 0.15
"""m between the robot and an obstacle in its way at which it stands."""
SLOW_GAP = 0.6
"""m: closer than this, the speed falls with the gap."""
LEAST_SPEED = 0.0285
"""m/s: the Create 2 drives no slower."""


def gap(ranges: Sequence[float], *, backward: bool = False) -> float:
    """Return the free metres before the robot's edge, on the strip that its body sweeps when it drives straight.

    `ranges` are in m, counter-clockwise from straight ahead in equal steps over the full turn; 0 means nothing seen.
    """
    side, sign = RADIUS + SIDE_MARGIN, -1.0 if backward else 1.0
    ahead = (
        sign * distance * along
        for distance, (along, across) in zip(ranges, _directions(len(ranges)), strict=True)
        if sign * distance * along > 0 and abs(distance * across) < side
    )
    return min(ahead, default=math.inf) - RADIUS


@lru_cache(maxsize=4)
def _directions(count: int) -> list[tuple[float, float]]:
    """Return cosine and sine of each range's angle."""
    return [(math.cos(index * math.tau / count), math.sin(index * math.tau / count)) for index in range(count)]


def held_back(motion: Motion, free: float) -> Motion:
    """Slow a motion down to what `free` metres allow; turning on the spot needs none."""
    if motion.forward == 0 or free >= SLOW_GAP:
        return motion
    factor = (free - STOP_GAP) / (SLOW_GAP - STOP_GAP)
    if abs(motion.forward) * factor < LEAST_SPEED:
        return Motion()
    return Motion(motion.forward * factor, motion.turn * factor)
