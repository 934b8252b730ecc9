"""Drives the robot: orders and scans in, odometry and state out."""

from __future__ import annotations

import logging
import math
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from modules.navigation.create2 import MODES, Create2
from modules.navigation.odometry import Odometry
from modules.navigation.open_interface import BAUD
from modules.navigation.orders import parse_order, parse_ranges
from modules.navigation.pilot import DRIVE_PATIENCE, SCAN_PATIENCE, Drive, Pilot
from modules.navigation.speedometer import Speedometer
from modules.navigation.stamp_check import StampCheck
from modules.navigation.waypoints import STILL
from robotkit import DeviceError, MessageError, Result, Task
from robotkit.line import open_line

if TYPE_CHECKING:
    from collections.abc import Generator

    from modules.navigation.create2 import Sensors
    from robotkit import Decision, Received

CYCLE_S = 0.1
"""In a tenth of a second the robot drives 2 cm blindly; at half of that, steering alone would need more than 10m."""
ODOMETRY_EVERY, STATE_EVERY = 2, 10
"""Cycles from one result to the next."""
SILENCE_S = 1.0
"""A robot that has streamed nothing for this long is off, unplugged or does not receive us."""

_LOG = logging.getLogger(__name__)


class Navigation(Task):
    """One robot on one serial line.

    Whatever stops it does so at once, on the calling thread: the order is dropped and the wheels stopped under the same
    lock under which the control cycle sets their speed, so no late command can start them again.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._lock = threading.Lock()
        self._pilot = Pilot()
        self._stamps = {name: StampCheck(name) for name in ("order", "scan")}
        self._odometry = Odometry()
        self._speedometer = Speedometer(self._odometry)
        self._robot: Create2 | None = None
        self._moving = STILL
        self._sensors: Sensors | None = None

    def process(self, received: Received) -> None:
        """Take an order or a scan."""
        now = time.monotonic()
        self._stamps[received.input].hear(received.stamp, received.received)
        if received.input == "scan":
            self._see(received, now)
            return
        order = parse_order(received.payload, now)
        if isinstance(order, str):  # a stop is never too old
            self._stop("stopped")
            return
        if isinstance(order, Drive):
            order = self._timely(order, received)
        with self._lock:
            if self._robot is None:
                raise DeviceError(f"{self._port}: no robot is connected to carry out an order")
            if not self._pilot.wanted:
                self._robot.arm()
            self._pilot.follow(order, now)

    def _timely(self, order: Drive, received: Received) -> Drive:
        """Count the order's time from its publication; one that comes too late still ends the order before it."""
        try:
            age = self._stamps["order"].age(received.stamp, time.time_ns(), DRIVE_PATIENCE)
        except MessageError:
            self._stop("order expired")
            raise
        return replace(order, until=order.until - age)

    def _see(self, received: Received, now: float) -> None:
        if self._pilot.wanted:  # a robot that stands needs no eyes
            age = self._stamps["scan"].age(received.stamp, time.time_ns(), SCAN_PATIENCE)
            ranges = parse_ranges(received.payload)
            with self._lock:
                self._pilot.see(ranges, now - age)

    def adapt(self, decision: Decision) -> None:
        """Stop when suspended; how much CPU there is otherwise makes no difference to what is safe."""
        if decision.suspended:
            self._stop("suspended")

    def close(self) -> None:
        """Stop."""
        self._stop("closed")

    def produce(self, ended: threading.Event) -> Generator[Result, None, None]:
        """Control the robot 10 times a second until `ended` is set, or DeviceError."""
        with open_line(self._port, BAUD) as line:
            robot = Create2(line)
            if not self._take(robot, ended):
                return
            try:
                yield from self._control(robot, ended)
            finally:
                self._let_go(robot, "suspended" if ended.is_set() else "unplugged")

    def _take(self, robot: Create2, ended: threading.Event) -> bool:
        """Make it the robot that orders are for, unless the task was suspended while its line was being opened."""
        with self._lock:
            if ended.is_set():  # by now another thread may have a robot
                return False
            robot.start()
            self._odometry.restart()
            self._robot = robot
        _LOG.info("%s: sensor data requested", self._port)
        return True

    def _control(self, robot: Create2, ended: threading.Event) -> Generator[Result, None, None]:
        heard, cycle = time.monotonic(), 0
        while not ended.wait(CYCLE_S):
            frames = robot.sensors()
            now = time.monotonic()
            if not frames:
                if now - heard > SILENCE_S:
                    raise DeviceError(f"{self._port}: no sensor data for {SILENCE_S:g} s: check that the robot is on")
                continue
            heard, cycle, self._sensors = now, cycle + 1, frames[-1]
            self._odometry.update(self._sensors.left, self._sensors.right)
            self._steer(robot, frames, now)
            if cycle == 1:
                self._speedometer.read(now)  # from now on: nobody counted while there was no robot
            if cycle % ODOMETRY_EVERY == 0:
                yield Result("odometry", self._where(now))
            if cycle % STATE_EVERY == 0:
                yield Result("state", self._state(robot))

    def _steer(self, robot: Create2, frames: list[Sensors], now: float) -> None:
        """Repeat the command while the robot moves: the guard takes our silence for death."""
        with self._lock:
            motion = self._pilot.move(self._odometry.pose, frames, now)
            if motion != STILL:
                robot.drive(*motion.wheels())
            elif self._moving != STILL:
                robot.halt()
            self._moving = motion

    def _stop(self, why: str) -> None:
        with self._lock:
            self._pilot.end(why)
            self._moving = STILL
            if self._robot is not None:
                self._robot.halt()

    def _let_go(self, robot: Create2, why: str) -> None:
        with self._lock:
            if self._robot is not robot:  # another thread has it since
                return
            self._pilot.end(why)
            self._robot, self._moving = None, STILL
            try:
                robot.release()
            except DeviceError:
                _LOG.warning("%s: could not stop the robot; the guard process will", self._port)

    def _where(self, now: float) -> dict[str, object]:
        pose, moving = self._odometry.pose, self._speedometer.read(now)
        return {
            "position": [round(pose.x, 4), round(pose.y, 4)],
            "heading": round(pose.heading, 4),
            "travelled": round(self._odometry.travelled, 3),
            "forward": round(moving.forward, 3),
            "turn": round(moving.turn, 3),
        }

    def _state(self, robot: Create2) -> dict[str, object]:
        sensors, pilot = self._sensors, self._pilot
        if sensors is None:
            return {"doing": pilot.doing}
        return {
            "doing": pilot.doing,
            "waypoints": pilot.waypoints_left,
            "gap": round(pilot.gap, 3) if math.isfinite(pilot.gap) else None,
            "mode": MODES.get(sensors.mode, "unknown"),
            "battery": sensors.battery,
            "voltage": sensors.voltage / 1000,
            "current": sensors.current / 1000,
            "charging": sensors.charging,
            "skipped": robot.skipped,
        }
