"""How fast the robot really is: blocked, disarmed or too slow for an order, it moves less than ordered."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from modules.navigation.waypoints import Motion

if TYPE_CHECKING:
    from modules.navigation.odometry import Odometry


class Speedometer:
    """Speeds from what the encoders counted."""

    def __init__(self, odometry: Odometry) -> None:
        self._odometry = odometry
        self._run, self._turned, self._read = 0.0, 0.0, -math.inf

    def read(self, now: float) -> Motion:
        """Return the mean speeds since it was last read; `now` is in s, and later than then."""
        seconds = now - self._read
        run, turned = self._odometry.run - self._run, self._odometry.turned - self._turned
        self._run, self._turned, self._read = self._odometry.run, self._odometry.turned, now
        return Motion(run / seconds, turned / seconds)
