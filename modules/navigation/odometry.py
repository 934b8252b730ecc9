"""Where the robot is, from what its wheels have turned.

The Create 2 counts 508.8 steps per turn of a 72 mm wheel, in 16 bits that roll over about every 14.5 m. Its own
distance and angle packets are wrong before firmware 3.4.1, so they are not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

METRES_PER_COUNT = math.pi * 0.072 / 508.8
WHEEL_BASE = 0.235
_TURN = 1 << 16


@dataclass(frozen=True, slots=True)
class Pose:
    """In the frame in which the odometry began: m, and rad counter-clockwise from its x axis, within +-pi."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


def moved(pose: Pose, left: float, right: float, *, wheel_base: float = WHEEL_BASE) -> Pose:
    """Follow the arc on which the wheels ran these metres."""
    turn = (right - left) / wheel_base
    chord = (left + right) / 2 * _sinc(turn / 2)
    middle = pose.heading + turn / 2
    return Pose(pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), wrapped(pose.heading + turn))


def wrapped(angle: float) -> float:
    """Return the same angle within +-pi."""
    return math.remainder(angle, math.tau)


def counted(before: int, after: int) -> int:
    """How many counts lie between two readings, whichever way round and across the roll-over."""
    return (after - before + _TURN // 2) % _TURN - _TURN // 2


class Odometry:
    """Adds up encoder readings."""

    def __init__(self) -> None:
        self.pose = Pose()
        self.travelled = 0.0
        self.run, self.turned = 0.0, 0.0
        """Metres forward less those backward, and radians counter-clockwise less those clockwise."""
        self._last: tuple[int, int] | None = None

    def update(self, left: int, right: int) -> Pose:
        """Take the next reading of both encoders."""
        if self._last is not None:
            run_left = counted(self._last[0], left) * METRES_PER_COUNT
            run_right = counted(self._last[1], right) * METRES_PER_COUNT
            self.pose = moved(self.pose, run_left, run_right)
            run = (run_left + run_right) / 2
            self.travelled += abs(run)
            self.run += run
            self.turned += (run_right - run_left) / WHEEL_BASE
        self._last = (left, right)
        return self.pose

    def restart(self) -> None:
        """Keep the pose, but take the next reading as a new beginning: the robot was reset or out of reach."""
        self._last = None


def _sinc(angle: float) -> float:
    return math.sin(angle) / angle if angle else 1.0
