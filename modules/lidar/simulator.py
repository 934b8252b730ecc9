"""`python -m modules.lidar.simulator`: an RPLIDAR A1 in a room, as its data sheet describes it.

It is idle until a scan is asked for, turns at 5.5 Hz, measures 2000 times a second (4000 in express mode) up to 12 m,
leaves the scan at any other request, and does not scan while it protects itself from an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from modules.lidar import rplidar
from modules.lidar.rplidar import HEALTHY, PROTECTING, Capsule, Command, Health, Info, Node, RequestParser
from modules.lidar.scan_modes import EXPRESS, FAR, STANDARD, configuration, sample_rate
from robotkit.simulated import main

NEAR = 0.15
"""m: closer, and beyond FAR, nothing comes back."""
TURNS_PER_SECOND = 5.5
INFO = Info(model=0x18, firmware=(1, 29), hardware=7, serial=bytes(range(16)))
BOOT_MESSAGE = b"RP LIDAR System.\r\nFirmware Ver 1.29, HW Ver 7\r\nModel: 18\r\n"

Distance = Callable[[float], float]
"""From an angle in degrees, clockwise from the front, to m; 0 or infinity for nothing."""
Wall = tuple[float, float, float, float]
ROOM: tuple[Wall, ...] = ((-2, -1.5, 3, -1.5), (3, -1.5, 3, 1.5), (3, 1.5, -2, 1.5), (-2, 1.5, -2, -1.5))


class RplidarA1:
    """The lidar behind its serial port."""

    period = 0.02

    def __init__(self, distance: Distance) -> None:
        self.health = Health(HEALTHY, 0)
        self.scanning: Command | None = None
        self._distance = distance
        self._parser = RequestParser()
        self._angle = 0.0
        self._due = 0.0
        self._first = True

    def receive(self, data: bytes) -> bytes:
        """Carry out the requests that are complete."""
        return b"".join(self._obey(command, payload) for command, payload in self._parser.feed(data))

    def advance(self, seconds: float) -> bytes:
        """Turn and send what was measured meanwhile."""
        if self.scanning is None:
            return b""
        express = self.scanning is Command.EXPRESS_SCAN
        rate = (EXPRESS if express else STANDARD).rate
        self._due += seconds * rate
        step = rplidar.FULL_TURN * TURNS_PER_SECOND / rate
        sent, size = bytearray(), 2 * rplidar.CABINS if express else 1
        while self._due >= size:
            self._due -= size
            sent += self._capsule(step) if express else self._node(step)
        return bytes(sent)

    def _obey(self, command: int, payload: bytes) -> bytes:
        answers: dict[int, bytes] = {
            Command.GET_INFO: rplidar.INFO_DESCRIPTOR.encode() + INFO.encode(),
            Command.GET_HEALTH: rplidar.HEALTH_DESCRIPTOR.encode() + self.health.encode(),
            Command.GET_SAMPLERATE: sample_rate(),
            Command.GET_LIDAR_CONF: configuration(payload),
        }
        self.scanning = None
        if command == Command.RESET:
            self.health = Health(HEALTHY, 0)
            return BOOT_MESSAGE
        if command in {Command.SCAN, Command.FORCE_SCAN, Command.EXPRESS_SCAN}:
            return self._start(Command(command))
        return answers.get(command, b"")

    def _start(self, command: Command) -> bytes:
        if self.health.status == PROTECTING:
            return b""
        self.scanning, self._first, self._due = command, True, 0.0
        express = command is Command.EXPRESS_SCAN
        return (rplidar.EXPRESS_DESCRIPTOR if express else rplidar.SCAN_DESCRIPTOR).encode()

    def _measure(self, angle: float) -> int:
        """Return the distance in mm; 0 where the lidar sees nothing."""
        metres = self._distance(angle)
        return round(metres * 1000) if NEAR <= metres <= FAR else 0

    def _step(self, step: float) -> tuple[float, bool]:
        """Return the angle of the next sample, and whether a turn begins with it."""
        angle = math.floor(self._angle * 64) / 64
        start, self._first = self._first or self._angle < step, False
        self._angle = (self._angle + step) % rplidar.FULL_TURN
        return angle, start

    def _node(self, step: float) -> bytes:
        angle, start = self._step(step)
        distance = self._measure(angle)
        return Node(angle, distance, 15 if distance else 0, start).encode()

    def _capsule(self, step: float) -> bytes:
        samples = [self._step(step)[0] for _ in range(2 * rplidar.CABINS)]
        start, self._first = self._first, False
        distances = tuple(self._measure(angle) for angle in samples)
        return Capsule(samples[0], distances, (0,) * len(samples), start).encode()


def seen(walls: Sequence[Wall], x: float, y: float, direction: float) -> float:
    """Return the distance in m to the nearest wall in a direction (rad, counter-clockwise); infinity for none."""
    return min((_hit(wall, x, y, direction) for wall in walls), default=math.inf)


def _hit(wall: Wall, x: float, y: float, direction: float) -> float:
    ray_x, ray_y = math.cos(direction), math.sin(direction)
    along_x, along_y = wall[2] - wall[0], wall[3] - wall[1]
    across = ray_x * along_y - ray_y * along_x
    if not across:
        return math.inf
    to_x, to_y = wall[0] - x, wall[1] - y
    distance = (to_x * along_y - to_y * along_x) / across
    part = (to_x * ray_y - to_y * ray_x) / across
    return distance if distance >= 0 and 0 <= part <= 1 else math.inf


if __name__ == "__main__":
    main(RplidarA1(lambda angle: seen(ROOM, 0, 0, -math.radians(angle))), "RPLIDAR A1")
