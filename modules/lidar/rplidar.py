"""The serial protocol of the RPLIDAR A1: requests, descriptors, answers and the two kinds of scan data.

Source: SLAMTEC, RPLIDAR Interface Protocol and Application Notes (A1 and A2), and the public SDK's `sl_lidar_cmd.h`.
Numbers are little-endian. Angles are clockwise from the front, seen from above.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

BAUD = 115_200
REQUEST_START = 0xA5
DESCRIPTOR_START = b"\xa5\x5a"
DESCRIPTOR_SIZE, NODE_SIZE, CAPSULE_SIZE = 7, 5, 84
CABINS = 16
HEALTHY, WARNING, PROTECTING = 0, 1, 2
"""Values of a health's status."""
FULL_TURN = 360.0

_HAS_PAYLOAD = 0x80
_DESCRIPTOR = struct.Struct("<2sIB")
_NODE = struct.Struct("<BHH")
_INFO = struct.Struct("<BBBB16s")
_HEALTH = struct.Struct("<BH")
_CABIN = struct.Struct("<HHB")
_SYNC_BIT = 0x8000


class Command(IntEnum):
    """Requests that an A1 supports."""

    SCAN = 0x20
    FORCE_SCAN = 0x21
    STOP = 0x25
    RESET = 0x40
    GET_INFO = 0x50
    GET_HEALTH = 0x52
    GET_SAMPLERATE = 0x59
    EXPRESS_SCAN = 0x82
    GET_LIDAR_CONF = 0x84


class AnswerType(IntEnum):
    """What a descriptor announces."""

    INFO = 0x04
    HEALTH = 0x06
    SAMPLERATE = 0x15
    LIDAR_CONF = 0x20
    SCAN = 0x81
    EXPRESS_SCAN = 0x82


@dataclass(frozen=True, slots=True)
class Descriptor:
    """Announces an answer of `size` bytes, repeated without end when it is `multiple`."""

    size: int
    multiple: bool
    type: int

    def encode(self) -> bytes:
        """Return the seven bytes."""
        return _DESCRIPTOR.pack(DESCRIPTOR_START, self.size | self.multiple << 30, self.type)


@dataclass(frozen=True, slots=True)
class Info:
    """What the device is; `firmware` is (major, minor)."""

    model: int
    firmware: tuple[int, int]
    hardware: int
    serial: bytes

    def encode(self) -> bytes:
        """Return the 20 bytes."""
        return _INFO.pack(self.model, self.firmware[1], self.firmware[0], self.hardware, self.serial)


@dataclass(frozen=True, slots=True)
class Health:
    """`status` 0 is good, 1 a warning, 2 an error: the lidar protects itself and does not scan until it is reset."""

    status: int
    error: int

    def encode(self) -> bytes:
        """Return the three bytes."""
        return _HEALTH.pack(self.status, self.error)


@dataclass(frozen=True, slots=True)
class Node:
    """One measurement: degrees, mm (0: nothing was measured), 0 to 63; `start` marks the first one of a turn."""

    angle: float
    distance: float
    quality: int
    start: bool = False

    def encode(self) -> bytes:
        """Return the five bytes."""
        flags = self.quality << 2 | (not self.start) << 1 | self.start
        return _NODE.pack(flags, round(self.angle * 64) << 1 | 1, round(self.distance * 4))


@dataclass(frozen=True, slots=True)
class Capsule:
    """Express data: 32 samples that begin at `angle`; offsets (q3 degrees, 0 to 63) correct each sample's angle."""

    angle: float
    distances: tuple[int, ...]
    offsets: tuple[int, ...]
    start: bool = False

    def encode(self) -> bytes:
        """Return the 84 bytes."""
        body = struct.pack("<H", round(self.angle * 64) | self.start << 15)
        for at in range(0, 2 * CABINS, 2):
            (first, second), (turn, other) = self.distances[at : at + 2], self.offsets[at : at + 2]
            body += _CABIN.pack(first << 2 | turn >> 4, second << 2 | other >> 4, (turn & 15) | (other & 15) << 4)
        checksum = _checksum(body)
        return bytes([0xA0 | checksum & 15, 0x50 | checksum >> 4]) + body


def _checksum(data: Sequence[int]) -> int:
    return reduce(xor, data, 0)


def request(command: Command, payload: bytes = b"") -> bytes:
    """Build a request; one with data ends in the XOR of all its bytes."""
    head = bytes([REQUEST_START, command])
    if not command & _HAS_PAYLOAD:
        return head
    packet = head + bytes([len(payload)]) + payload
    return packet + bytes([_checksum(packet)])


SCAN = request(Command.SCAN)
STOP = request(Command.STOP)
RESET = request(Command.RESET)
GET_INFO = request(Command.GET_INFO)
GET_HEALTH = request(Command.GET_HEALTH)
EXPRESS_SCAN = request(Command.EXPRESS_SCAN, bytes(5))

SCAN_DESCRIPTOR = Descriptor(NODE_SIZE, multiple=True, type=AnswerType.SCAN)
EXPRESS_DESCRIPTOR = Descriptor(CAPSULE_SIZE, multiple=True, type=AnswerType.EXPRESS_SCAN)
INFO_DESCRIPTOR = Descriptor(_INFO.size, multiple=False, type=AnswerType.INFO)
HEALTH_DESCRIPTOR = Descriptor(_HEALTH.size, multiple=False, type=AnswerType.HEALTH)


class RequestParser:
    """The lidar's side: requests from bytes in pieces of any size; anything else, or a wrong checksum, is skipped."""

    def __init__(self) -> None:
        self.skipped = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Take the next bytes and give command and payload of each request that is complete now."""
        self._buffer += data
        requests = []
        while (size := self._size()) is not None and len(self._buffer) >= size:
            packet = bytes(self._buffer[:size])
            if packet[0] != REQUEST_START or (packet[1] & _HAS_PAYLOAD and _checksum(packet)):
                del self._buffer[0]
                self.skipped += 1
                continue
            requests.append((packet[1], packet[3:-1]))
            del self._buffer[:size]
        return requests

    def _size(self) -> int | None:
        """The request's total size in bytes; None while the byte that gives it is still to come."""
        if self._buffer and self._buffer[0] != REQUEST_START:
            return 1
        if len(self._buffer) < 2:
            return None
        if not self._buffer[1] & _HAS_PAYLOAD:
            return 2
        return 4 + self._buffer[2] if len(self._buffer) > 2 else None


def find_answer(data: bytes, wanted: Descriptor) -> int | None:
    """Where the answer announced by this descriptor begins; None while the descriptor has not arrived."""
    at = data.find(wanted.encode())
    return None if at < 0 else at + DESCRIPTOR_SIZE


def decode_info(data: bytes) -> Info:
    """Read the answer to GET_INFO."""
    model, minor, major, hardware, serial = _INFO.unpack(data)
    return Info(model, (major, minor), hardware, serial)


def decode_health(data: bytes) -> Health:
    """Read the answer to GET_HEALTH."""
    return Health(*_HEALTH.unpack(data))


def decode_node(data: bytes) -> Node | None:
    """Read five bytes; None: the check bits show that they are not a measurement."""
    flags, angle, distance = _NODE.unpack(data)
    start = bool(flags & 1)
    if start == bool(flags & 2) or not angle & 1 or angle >> 1 >= FULL_TURN * 64:
        return None
    return Node((angle >> 1) / 64, distance / 4, flags >> 2, start)


def decode_capsule(data: bytes) -> Capsule | None:
    """Read 84 bytes; None: sync marks or checksum show that they are not a capsule."""
    if data[0] >> 4 != 0xA or data[1] >> 4 != 0x5 or _checksum(data[2:]) != (data[0] & 15 | (data[1] & 15) << 4):
        return None
    (angle,) = struct.unpack_from("<H", data, 2)
    distances: list[int] = []
    offsets: list[int] = []
    for first, second, low in _CABIN.iter_unpack(data[4:]):
        distances += (first >> 2, second >> 2)
        offsets += (low & 15 | (first & 3) << 4, low >> 4 | (second & 3) << 4)
    return Capsule((angle & ~_SYNC_BIT) / 64, tuple(distances), tuple(offsets), bool(angle & _SYNC_BIT))


def capsule_nodes(capsule: Capsule, following: Capsule) -> list[Node]:
    """Return the samples of a capsule; the angle at which they end comes from the following capsule.

    Offsets are read as unsigned, as in the SDK; the data sheet mentions a sign bit that devices do not use.
    """
    step = (following.angle - capsule.angle) % FULL_TURN / (2 * CABINS)
    return [
        Node((capsule.angle + index * step - offset / 8) % FULL_TURN, float(distance), 47 if distance else 0)
        for index, (distance, offset) in enumerate(zip(capsule.distances, capsule.offsets, strict=True))
    ]
