"""From a pose and the next waypoint to the speeds of the wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from modules.navigation.odometry import WHEEL_BASE, wrapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.navigation.odometry import Pose

CRUISE = 0.2
"""m/s."""
TURN = 1.0
"""rad/s, at most."""
REACHED = 0.05
"""m: closer than this, a waypoint is reached."""
TURN_FIRST = math.radians(30)
"""A waypoint further aside than this is turned to on the spot."""
TURN_GAIN = 1.5
BRAKE_GAIN = 0.8
SLOWEST = 0.06
"""m/s: two of the 28.5 mm/s steps in which the Create 2 controls its speed."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Motion:
    """`forward` in m/s, `turn` in rad/s counter-clockwise."""

    forward: float = 0.0
    turn: float = 0.0

    def wheels(self) -> tuple[int, int]:
        """Left and right in mm/s; too much for a wheel slows both, so that the curve stays the same."""
        half = self.turn * WHEEL_BASE / 2
        left, right = (self.forward - half) * 1000, (self.forward + half) * 1000
        excess = max(abs(left), abs(right)) / 500
        if excess > 1:
            left, right = left / excess, right / excess
        return round(left), round(right)


STILL = Motion()


class Route:
    """Waypoints that are driven to one after the other."""

    def __init__(self, waypoints: Sequence[Point]) -> None:
        self._left = list(waypoints)

    @property
    def left(self) -> int:
        """How many waypoints are still ahead."""
        return len(self._left)

    def next_motion(self, pose: Pose) -> Motion | None:
        """Return the motion towards the next waypoint that is not reached yet, or None at the end."""
        while self._left and math.dist((pose.x, pose.y), self._left[0]) < REACHED:
            del self._left[0]
        return _towards(self._left[0], pose) if self._left else None


def _towards(target: Point, pose: Pose) -> Motion:
    distance = math.dist((pose.x, pose.y), target)
    aside = wrapped(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.heading)
    turn = min(max(TURN_GAIN * aside, -TURN), TURN)
    if abs(aside) > TURN_FIRST:
        return Motion(0.0, turn)
    return Motion(max(min(CRUISE, BRAKE_GAIN * distance), SLOWEST) * math.cos(aside), turn)
