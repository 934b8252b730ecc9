"""`python -m modules.navigation.simulator`: an iRobot Create 2 in a room, as the specification describes it.

It has four modes, takes actuator commands in Safe and Full mode only, leaves Safe mode for Passive with its wheels
stopped when a wheel drops or a cliff is ahead, waits for the rest of an incomplete command, streams every 15 ms and has
no watchdog: wheels go on turning at the last speed, whatever has died.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from modules.navigation import packets
from modules.navigation.odometry import METRES_PER_COUNT, WHEEL_BASE, Pose, moved
from modules.navigation.open_interface import CLOCKWISE, COUNTER_CLOCKWISE, STRAIGHT, Command, CommandParser, Opcode
from modules.navigation.simulated_memory import Journey, Jukebox
from robotkit.simulated import main

if TYPE_CHECKING:
    from collections.abc import Sequence

RADIUS = 0.174
SPEED_STEP = 28.5
"""mm/s: the speed controller knows no speeds between."""
BOOT_MESSAGE = b"bl-start\r\nr3_robot/tags/release-3.5.4:5868 CLEAN\r\n"
_PASSIVE_OPCODES = {Opcode.START, Opcode.POWER, Opcode.SPOT, Opcode.CLEAN, Opcode.MAX, Opcode.SEEK_DOCK}

Wall = tuple[float, float, float, float]


@dataclass
class Body:
    """What the world does to the robot; `slip` is how far a wheel's way differs from its counts, bias and deviation."""

    walls: Sequence[Wall] = ()
    pose: Pose = field(default_factory=Pose)
    slip_bias: tuple[float, float] = (0.0, 0.0)
    slip_deviation: float = 0.0
    counts: list[float] = field(default_factory=lambda: [0.0, 0.0])
    bumps: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)  # noqa: S311 - a simulation must repeat itself

    def roll(self, left: float, right: float) -> None:
        """Turn the wheels by these metres; walls hold the body, its wheels then slip."""
        if not (left or right):
            return  # a pressed bumper stays pressed
        self.counts[0] += left / METRES_PER_COUNT
        self.counts[1] += right / METRES_PER_COUNT
        true_left, true_right = (
            way * (1 + bias + self._random.gauss(0, self.slip_deviation))
            for way, bias in zip((left, right), self.slip_bias, strict=True)
        )
        pose = moved(self.pose, true_left, true_right, wheel_base=WHEEL_BASE)
        self.bumps = _bumps(pose, self.walls)
        if not self.bumps:
            self.pose = pose


class Create2:
    """The robot behind its serial port."""

    period = packets.FRAME_PERIOD

    def __init__(self, body: Body | None = None) -> None:
        self.body = body or Body()
        self.mode = packets.OFF
        self.wheels = (0.0, 0.0)
        self.drops = 0
        self.cliff = False
        self._parser = CommandParser()
        self._frame: packets.Frame | None = None
        self._streamed: tuple[int, ...] = ()
        self._streaming = False
        self._journey, self._jukebox = Journey(), Jukebox()
        self._requested: packets.Values = {}

    def receive(self, data: bytes) -> bytes:
        """Carry out the commands that are complete."""
        return b"".join(self._obey(command) for command in self._parser.feed(data))

    def advance(self, seconds: float) -> bytes:
        """Drive, look at the safety sensors, send a frame."""
        left, right = self.wheels
        self.body.roll(left * seconds, right * seconds)
        self._journey.roll(left * seconds, right * seconds)
        self._jukebox.advance(seconds)
        self._guard_safe_mode()
        if self.mode == packets.OFF or not self._streaming or self._frame is None:
            return b""
        return self._sent(self._streamed, self._frame.encode(self.values()))

    def values(self) -> packets.Values:
        """All sensors as they are now."""
        left, right = (_signed(int(count)) for count in self.body.counts)
        return {
            packets.BUMPS_AND_DROPS: self.body.bumps | self.drops,
            packets.CLIFF_FRONT_LEFT: int(self.cliff),
            packets.CLIFF_FRONT_RIGHT: int(self.cliff),
            packets.VOLTAGE: 15_800,
            packets.CURRENT: -350 - int(sum(abs(wheel) for wheel in self.wheels) * 1000),
            packets.TEMPERATURE: 25,
            packets.CHARGE: 2200,
            packets.CAPACITY: 2696,
            packets.OI_MODE: self.mode,
            packets.LEFT_ENCODER: left,
            packets.RIGHT_ENCODER: right,
            packets.STREAM_PACKETS: len(self._streamed),
            **self._journey.values(),
            **self._jukebox.values(),
            **self._requested,
        }

    def _obey(self, command: Command) -> bytes:
        if command.opcode is Opcode.RESET:
            self._enter(packets.OFF)
            return BOOT_MESSAGE
        if self.mode == packets.OFF and command.opcode is not Opcode.START:
            return b""
        if command.opcode in _PASSIVE_OPCODES:
            self._enter(packets.PASSIVE)
        if command.opcode in {Opcode.SENSORS, Opcode.QUERY_LIST}:
            return self._answer(command.arguments)
        self._act(command.opcode, command.arguments)
        return b""

    def _act(self, opcode: Opcode, arguments: tuple[int, ...]) -> None:
        match opcode:
            case Opcode.STOP:
                self._enter(packets.OFF)
            case Opcode.SAFE | Opcode.CONTROL:
                self._enter(packets.SAFE_MODE)
            case Opcode.FULL:
                self._enter(packets.FULL_MODE)
            case Opcode.SONG:
                self._jukebox.write(arguments[0], arguments[1:])
            case Opcode.STREAM:
                self._start_stream(arguments)
            case Opcode.PAUSE_RESUME_STREAM:
                self._streaming = arguments[0] == 1
            case _ if self.mode in {packets.SAFE_MODE, packets.FULL_MODE}:
                self._actuate(opcode, arguments)

    def _actuate(self, opcode: Opcode, arguments: tuple[int, ...]) -> None:
        """Commands that Safe and Full mode obey."""
        match opcode:
            case Opcode.DRIVE:
                self._requested |= {packets.REQUESTED_VELOCITY: arguments[0], packets.REQUESTED_RADIUS: arguments[1]}
                self._drive(*arguments)
            case Opcode.DRIVE_DIRECT:
                self._requested |= {packets.REQUESTED_RIGHT: arguments[0], packets.REQUESTED_LEFT: arguments[1]}
                self._set_wheels(arguments[1], arguments[0])
            case Opcode.DRIVE_PWM:
                self._set_wheels(arguments[1] * 500 / 255, arguments[0] * 500 / 255)
            case Opcode.PLAY:
                self._jukebox.play(*arguments)

    def _enter(self, mode: int) -> None:
        if mode in {packets.OFF, packets.PASSIVE}:
            self.wheels = (0.0, 0.0)
        if mode == packets.OFF:
            self._streaming, self._requested = False, {}
        self.mode = mode

    def _guard_safe_mode(self) -> None:
        if self.mode == packets.SAFE_MODE and (self.drops or (self.cliff and sum(self.wheels) > 0)):
            self._enter(packets.PASSIVE)

    def _set_wheels(self, left: float, right: float) -> None:
        self.wheels = (_stepped(left), _stepped(right))

    def _drive(self, velocity: int, radius: int) -> None:
        half = WHEEL_BASE * 500
        if radius in {STRAIGHT, 32767, 0}:
            self._set_wheels(velocity, velocity)
        elif radius in {CLOCKWISE, COUNTER_CLOCKWISE}:
            self._set_wheels(-velocity * radius, velocity * radius)
        else:
            self._set_wheels(velocity * (radius - half) / radius, velocity * (radius + half) / radius)

    def _start_stream(self, arguments: tuple[int, ...]) -> None:
        try:
            self._frame, self._streamed = packets.Frame(arguments), arguments
        except ValueError:
            self._frame, self._streamed = None, ()
        self._streaming = True

    def _answer(self, arguments: tuple[int, ...]) -> bytes:
        try:
            return self._sent(arguments, packets.Reading(arguments).encode(self.values()))
        except ValueError:
            return b""

    def _sent(self, sent: tuple[int, ...], data: bytes) -> bytes:
        """Note that these packets and groups are sent."""
        self._journey.reset(tuple(member for packet in sent for member in packets.members(packet)))
        return data


def _stepped(speed: float) -> float:
    """Return the speed in m/s that the controller makes of one in mm/s."""
    held = min(max(speed, -500.0), 500.0)
    return round(held / SPEED_STEP) * SPEED_STEP / 1000


def _signed(count: int) -> int:
    return (count + 0x8000) % 0x10000 - 0x8000


def _bumps(pose: Pose, walls: Sequence[Wall]) -> int:
    """Which halves of the bumper are pressed; what touches it from behind presses nothing but is reported as both."""
    bumps = 0
    for wall in walls:
        x, y = _nearest(pose, wall)
        if math.hypot(x - pose.x, y - pose.y) < RADIUS:
            aside = math.sin(math.atan2(y - pose.y, x - pose.x) - pose.heading)
            bumps |= packets.BUMP_LEFT if aside > -0.3 else 0
            bumps |= packets.BUMP_RIGHT if aside < 0.3 else 0
    return bumps


def _nearest(pose: Pose, wall: Wall) -> tuple[float, float]:
    """Return the point of the wall that is nearest to the robot."""
    x, y, end_x, end_y = wall
    along_x, along_y = end_x - x, end_y - y
    length = along_x**2 + along_y**2
    part = ((pose.x - x) * along_x + (pose.y - y) * along_y) / length if length else 0.0
    part = min(max(part, 0.0), 1.0)
    return x + part * along_x, y + part * along_y


if __name__ == "__main__":
    main(Create2(), "iRobot Create 2")
