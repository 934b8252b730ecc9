"""Commands of the iRobot Create 2 Open Interface: to bytes, and back from any stream of bytes.

Source: iRobot Create 2 Open Interface Specification, 10 August 2016. Numbers of 16 bits are big-endian and in two's
complement. An incomplete command makes the robot wait for the rest, so whatever is sent next would be taken for data:
`RESYNC` ends that wait.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

BAUD = 115_200
MAX_SPEED = 500
"""mm/s, of a wheel and of the robot."""
STRAIGHT, CLOCKWISE, COUNTER_CLOCKWISE = -32768, -1, 1
"""Radii of `drive` with a meaning of their own."""


class Opcode(IntEnum):
    """Every command of the specification."""

    RESET = 7
    START = 128
    BAUD = 129
    CONTROL = 130
    SAFE = 131
    FULL = 132
    POWER = 133
    SPOT = 134
    CLEAN = 135
    MAX = 136
    DRIVE = 137
    MOTORS = 138
    LEDS = 139
    SONG = 140
    PLAY = 141
    SENSORS = 142
    SEEK_DOCK = 143
    PWM_MOTORS = 144
    DRIVE_DIRECT = 145
    DRIVE_PWM = 146
    STREAM = 148
    QUERY_LIST = 149
    PAUSE_RESUME_STREAM = 150
    SCHEDULING_LEDS = 162
    DIGIT_LEDS_RAW = 163
    DIGIT_LEDS_ASCII = 164
    BUTTONS = 165
    SCHEDULE = 167
    SET_DAY_TIME = 168
    STOP = 173


_DATA = {
    Opcode.BAUD: struct.Struct("B"),
    Opcode.DRIVE: struct.Struct(">hh"),
    Opcode.MOTORS: struct.Struct("B"),
    Opcode.LEDS: struct.Struct("3B"),
    Opcode.PLAY: struct.Struct("B"),
    Opcode.SENSORS: struct.Struct("B"),
    Opcode.PWM_MOTORS: struct.Struct("3b"),
    Opcode.DRIVE_DIRECT: struct.Struct(">hh"),
    Opcode.DRIVE_PWM: struct.Struct(">hh"),
    Opcode.PAUSE_RESUME_STREAM: struct.Struct("B"),
    Opcode.SCHEDULING_LEDS: struct.Struct("2B"),
    Opcode.DIGIT_LEDS_RAW: struct.Struct("4B"),
    Opcode.DIGIT_LEDS_ASCII: struct.Struct("4B"),
    Opcode.BUTTONS: struct.Struct("B"),
    Opcode.SCHEDULE: struct.Struct("15B"),
    Opcode.SET_DAY_TIME: struct.Struct("3B"),
}
_NO_DATA = struct.Struct("")
_OPCODES = {int(opcode): opcode for opcode in Opcode}
_LISTS = {Opcode.STREAM, Opcode.QUERY_LIST}
MAX_LIST = 255

RESYNC = bytes(2 + MAX_LIST)
"""Ends any command that was cut off: zeros complete it harmlessly, and 0 is no opcode."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command; of `STREAM` and `QUERY_LIST` the arguments are the packets, of `SONG` the number and the notes."""

    opcode: Opcode
    arguments: tuple[int, ...] = ()

    def encode(self) -> bytes:
        """Return the bytes for the robot."""
        head = bytes([self.opcode])
        if self.opcode in _LISTS:
            return head + bytes([len(self.arguments), *self.arguments])
        if self.opcode is Opcode.SONG:
            number, *notes = self.arguments
            return head + bytes([number, len(notes) // 2, *notes])
        return head + _DATA.get(self.opcode, _NO_DATA).pack(*self.arguments)


class CommandParser:
    """The robot's side: commands from bytes in pieces of any size; bytes that are no opcode are skipped."""

    def __init__(self) -> None:
        self.skipped = 0
        self._buffer = bytearray()

    @property
    def waiting(self) -> bool:
        """A command has begun whose data bytes are still to come."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> list[Command]:
        """Take the next bytes and give the commands that are complete now."""
        self._buffer += data
        commands = []
        while self._buffer:
            opcode = _OPCODES.get(self._buffer[0])
            if opcode is None:
                del self._buffer[0]
                self.skipped += 1
                continue
            size = _size(opcode, self._buffer)
            if size is None or len(self._buffer) < size:
                break
            commands.append(_decode(opcode, bytes(self._buffer[1:size])))
            del self._buffer[:size]
        return commands


def _size(opcode: Opcode, command: bytearray) -> int | None:
    """The command's total size in bytes; None while the byte that gives it is still to come."""
    if opcode in _LISTS:
        return 2 + command[1] if len(command) > 1 else None
    if opcode is Opcode.SONG:
        return 3 + 2 * command[2] if len(command) > 2 else None
    return 1 + _DATA.get(opcode, _NO_DATA).size


def _decode(opcode: Opcode, data: bytes) -> Command:
    if opcode in _LISTS:
        return Command(opcode, tuple(data[1:]))
    if opcode is Opcode.SONG:
        return Command(opcode, (data[0], *data[2:]))
    return Command(opcode, _DATA.get(opcode, _NO_DATA).unpack(data))


def _check(name: str, value: int, least: int, most: int) -> None:
    if not least <= value <= most:
        raise ValueError(f"{name}: invalid value {value}: expected {least} to {most}")


def drive(velocity: int, radius: int) -> bytes:
    """Drive at `velocity` mm/s, forward positive, on a circle of `radius` mm, left positive, or e.g. STRAIGHT."""
    _check("velocity", velocity, -MAX_SPEED, MAX_SPEED)
    if radius not in {STRAIGHT, 32767}:
        _check("radius", radius, -2000, 2000)
    return Command(Opcode.DRIVE, (velocity, radius)).encode()


def drive_direct(*, right: int, left: int) -> bytes:
    """Set the speed of each wheel in mm/s; on the wire the right one comes first."""
    _check("right", right, -MAX_SPEED, MAX_SPEED)
    _check("left", left, -MAX_SPEED, MAX_SPEED)
    return Command(Opcode.DRIVE_DIRECT, (right, left)).encode()


def sensors(packet: int) -> bytes:
    """Ask once for a packet or a group of them; the answer has neither header nor checksum."""
    return Command(Opcode.SENSORS, (packet,)).encode()


def stream(packets: Sequence[int]) -> bytes:
    """Ask for a frame of these packets every 15 ms."""
    return Command(Opcode.STREAM, tuple(packets)).encode()


def pause_stream() -> bytes:
    """End the frames; the robot remembers the packets."""
    return Command(Opcode.PAUSE_RESUME_STREAM, (0,)).encode()


START = Command(Opcode.START).encode()
SAFE = Command(Opcode.SAFE).encode()
FULL = Command(Opcode.FULL).encode()
STOP = Command(Opcode.STOP).encode()
RESET = Command(Opcode.RESET).encode()
HALT = drive_direct(right=0, left=0)
"""Both wheels stand still; the robot goes on listening."""
