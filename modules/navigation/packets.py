"""Sensor packets of the Create 2: every packet and group, answers without frame, and the frames of a stream.

Source: the Open Interface specification. A frame is `19, n, id, data, ..., checksum`; all its bytes add up to 0 modulo
256. Bit 0 of packet 7 is the right bumper, bit 1 the left one.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

HEADER = 19
FRAME_PERIOD = 0.015
FRAME_LIMIT = 172
"""Bytes that 115200 baud carries in one period; the robot corrupts longer frames."""

BUMPS_AND_DROPS, CLIFF_LEFT, CLIFF_FRONT_LEFT, CLIFF_FRONT_RIGHT, CLIFF_RIGHT = 7, 9, 10, 11, 12
CHARGING_STATE, VOLTAGE, CURRENT, TEMPERATURE, CHARGE, CAPACITY = 21, 22, 23, 24, 25, 26
OI_MODE, LEFT_ENCODER, RIGHT_ENCODER = 35, 43, 44
DISTANCE, ANGLE = 19, 20
"""mm and degrees since they were last sent."""
SONG_NUMBER, SONG_PLAYING, STREAM_PACKETS = 36, 37, 38
REQUESTED_VELOCITY, REQUESTED_RADIUS, REQUESTED_RIGHT, REQUESTED_LEFT = 39, 40, 41, 42
"""What DRIVE, and DRIVE_DIRECT, asked for last: mm/s and mm."""

BUMP_RIGHT, BUMP_LEFT, DROP_RIGHT, DROP_LEFT = 1, 2, 4, 8
"""Bits of BUMPS_AND_DROPS."""
OFF, PASSIVE, SAFE_MODE, FULL_MODE = 0, 1, 2, 3
"""Values of OI_MODE."""

_UNSIGNED_BYTES = {*range(7, 19), 21, 34, 35, 36, 37, 38, 45, 52, 53, 58, 32}
_SIGNED_BYTES = {24}
_SIGNED_WORDS = {19, 20, 23, 39, 40, 41, 42, 43, 44, 54, 55, 56, 57}


def _code(packet: int) -> str:
    if packet in _UNSIGNED_BYTES:
        return "B"
    if packet in _SIGNED_BYTES:
        return "b"
    return "h" if packet in _SIGNED_WORDS else "H"


PACKETS = {packet: _code(packet) for packet in range(7, 59)}
"""The struct code of every packet that stands for one value."""

GROUPS = {
    0: range(7, 27),
    1: range(7, 17),
    2: range(17, 21),
    3: range(21, 27),
    4: range(27, 35),
    5: range(35, 43),
    6: range(7, 43),
    100: range(7, 59),
    101: range(43, 59),
    106: range(46, 52),
    107: range(54, 59),
}

Values = dict[int, int]


def members(packet: int) -> tuple[int, ...]:
    """Name the packets that a packet or a group consists of, in the order of their bytes."""
    if packet in GROUPS:
        return tuple(GROUPS[packet])
    if packet in PACKETS:
        return (packet,)
    raise ValueError(f"packet: invalid value {packet}: expected 0 to 58, 100, 101, 106 or 107")


def _codes(packet: int) -> str:
    return "".join(PACKETS[member] for member in members(packet))


class Reading:
    """An answer to SENSORS or QUERY_LIST: the packets' data one after the other."""

    def __init__(self, packets: Sequence[int]) -> None:
        self._members = [member for packet in packets for member in members(packet)]
        self._struct = struct.Struct(">" + "".join(map(_codes, packets)))

    @property
    def size(self) -> int:
        """How many bytes the answer has."""
        return self._struct.size

    def decode(self, data: bytes) -> Values:
        """Return the value of each packet."""
        return dict(zip(self._members, self._struct.unpack(data), strict=True))

    def encode(self, values: Mapping[int, int]) -> bytes:
        """Do as the robot does; a packet without a value is 0."""
        return self._struct.pack(*(values.get(member, 0) for member in self._members))


class Frame:
    """The frame that a stream of these packets repeats."""

    def __init__(self, packets: Sequence[int]) -> None:
        self._packets = tuple(packets)
        self._members = [member for packet in packets for member in members(packet)]
        content = "".join("B" + _codes(packet) for packet in packets)
        self._struct = struct.Struct(f">BB{content}B")
        self._values = struct.Struct(">2x" + "".join("x" + _codes(packet) for packet in packets) + "x")
        if self.size > FRAME_LIMIT:
            raise ValueError(
                f"packets: a frame of {self.size} bytes: expected at most {FRAME_LIMIT}, as fit into 15 ms"
            )
        self.start = bytes([HEADER, self.size - 3])
        self._ids = _positions(packets)

    @property
    def size(self) -> int:
        """All bytes, from the header to the checksum."""
        return self._struct.size

    def holds(self, data: bytes | bytearray) -> bool:
        """Return whether these bytes, as many as a frame has, are one."""
        return sum(data) % 256 == 0 and all(data[position] == packet for position, packet in self._ids)

    def decode(self, data: bytes | bytearray) -> Values:
        """Return the value of each packet."""
        return dict(zip(self._members, self._values.unpack(data), strict=True))

    def encode(self, values: Mapping[int, int]) -> bytes:
        """Do as the robot does; a packet without a value is 0."""
        body = bytearray(self.start)
        for packet in self._packets:
            body += bytes([packet]) + Reading([packet]).encode(values)
        return bytes(body) + bytes([-sum(body) % 256])


def _positions(packets: Sequence[int]) -> list[tuple[int, int]]:
    """Offsets in a frame of the packets' ids, as (offset, packet)."""
    positions, at = [], 2
    for packet in packets:
        positions.append((at, packet))
        at += 1 + struct.calcsize(">" + _codes(packet))
    return positions


class StreamParser:
    """Turns bytes that arrive in pieces of any size into frames; noise costs only the frames it hits."""

    def __init__(self, packets: Sequence[int]) -> None:
        self.skipped = 0
        self._frame = Frame(packets)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Values]:
        """Take the next bytes and give the frames that are complete now; `skipped` counts the bytes of none."""
        self._buffer += data
        frames = []
        while (candidate := self._next_candidate()) is not None:
            if self._frame.holds(candidate):
                frames.append(self._frame.decode(candidate))
                del self._buffer[: self._frame.size]
            else:
                self._skip(1)  # not all of it: the true header may be inside
        return frames

    def _next_candidate(self) -> bytearray | None:
        start = self._buffer.find(self._frame.start)
        if start < 0:
            half = self._buffer[-1:] == self._frame.start[:1]
            self._skip(len(self._buffer) - half)
            return None
        self._skip(start)
        return self._buffer[: self._frame.size] if len(self._buffer) >= self._frame.size else None

    def _skip(self, count: int) -> None:
        del self._buffer[:count]
        self.skipped += count
