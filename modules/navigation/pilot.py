"""Decides from orders, scans and sensors how the robot moves, and says why. Pure: time is an argument, in seconds.

Obstacles and missing scans hold the robot back for as long as they last. Everything else that stops it (a stop, a
suspension, a bump, a cliff, being lifted, having left Safe mode) ends the order: it needs a new one to move again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from modules.navigation import packets
from modules.navigation.obstacles import gap, held_back
from modules.navigation.waypoints import STILL, Motion, Route

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.navigation.create2 import Sensors
    from modules.navigation.odometry import Pose

SCAN_PATIENCE = 0.6
"""Three turns of the lidar; a robot that has seen nothing for longer is blind."""
DRIVE_PATIENCE = 0.5
"""How long a `drive` order holds: manual control must keep repeating it."""
ARMING_S = 0.3
"""What the robot may take to enter Safe mode."""


@dataclass(frozen=True, slots=True)
class Drive:
    """An order to move like this until `until`."""

    motion: Motion
    until: float


class Pilot:
    """What the robot is to do, and what it may."""

    def __init__(self) -> None:
        self.doing = "idle"
        self.gap = math.inf
        self._order: Drive | Route | None = None
        self._gaps = (math.inf, math.inf)
        self._seen = -math.inf
        self._armed = -math.inf

    @property
    def wanted(self) -> bool:
        """There is an order that is not done."""
        return self._order is not None

    @property
    def waypoints_left(self) -> int:
        """How many waypoints are ahead."""
        return self._order.left if isinstance(self._order, Route) else 0

    def follow(self, order: Drive | Route, now: float) -> None:
        """Take a new order in place of the old one."""
        if self._order is None:
            self._armed = now
        self._order = order

    def end(self, why: str) -> None:
        """Forget the order: the robot stands until there is a new one."""
        self._order, self.doing = None, why

    def see(self, ranges: Sequence[float], when: float) -> None:
        """Take what the lidar saw at a time."""
        self._gaps = gap(ranges), gap(ranges, backward=True)
        self._seen = when

    def move(self, pose: Pose, sensors: Sequence[Sensors], now: float) -> Motion:
        """Return the motion for this moment; of several frames of sensors, none is overlooked."""
        if self._order is None:
            return STILL
        if hazard := self._hazard(sensors, now):
            self.end(hazard)
            return STILL
        motion = self._ordered(pose, now)
        return STILL if motion is None else self._allowed(motion, now)

    def _hazard(self, sensors: Sequence[Sensors], now: float) -> str | None:
        if any(frame.lifted for frame in sensors):
            return "lifted"
        if any(frame.cliff for frame in sensors):
            return "cliff"
        if any(frame.bumped for frame in sensors) and not self._backing_off():
            return "bumped"
        left_safe_mode = any(frame.mode != packets.SAFE_MODE for frame in sensors)
        return "disarmed" if left_safe_mode and now - self._armed > ARMING_S else None

    def _backing_off(self) -> bool:
        return isinstance(self._order, Drive) and self._order.motion.forward < 0

    def _ordered(self, pose: Pose, now: float) -> Motion | None:
        if isinstance(self._order, Route):
            motion = self._order.next_motion(pose)
            if motion is None:
                self.end("arrived")
            return motion
        if self._order is not None and now > self._order.until:
            self.end("order expired")
            return None
        return None if self._order is None else self._order.motion

    def _allowed(self, motion: Motion, now: float) -> Motion:
        if now - self._seen > SCAN_PATIENCE:
            self.doing = "blind"
            return STILL
        self.gap = self._gaps[motion.forward < 0]
        held = held_back(motion, self.gap)
        self.doing = "obstacle" if held == STILL != motion else "driving"
        return held
