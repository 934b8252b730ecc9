"""What a simulated RPLIDAR A1 answers about its scan modes: GET_SAMPLERATE and, since firmware 1.24, GET_LIDAR_CONF.

SLAMTEC's SDK asks for both before it starts a scan. A real A1 has a third mode, Boost (8000 samples a second in a
format of its own), which is neither simulated nor listed here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from modules.lidar.rplidar import AnswerType, Descriptor


@dataclass(frozen=True, slots=True)
class ScanMode:
    """One way to scan: samples a second, the type of its data."""

    name: str
    rate: float
    answer: AnswerType


STANDARD = ScanMode("Standard", 2000.0, AnswerType.SCAN)
EXPRESS = ScanMode("Express", 4000.0, AnswerType.EXPRESS_SCAN)
SCAN_MODES = (STANDARD, EXPRESS)
"""A mode's place is its number."""
FAR = 12.0
"""m: beyond, nothing comes back."""

_Q8 = 256
"""Fixed-point numbers have 8 bits after the point."""


class Entry(IntEnum):
    """What GET_LIDAR_CONF can be asked for; all but COUNT and TYPICAL of a mode, whose number follows."""

    COUNT = 0x70
    US_PER_SAMPLE = 0x71
    MAX_DISTANCE = 0x74
    ANSWER_TYPE = 0x75
    TYPICAL = 0x7C
    NAME = 0x7F


def sample_rate() -> bytes:
    """Answer GET_SAMPLERATE: how long a sample takes in standard and in express mode, in us."""
    data = struct.pack("<HH", *(round(1e6 / mode.rate) for mode in SCAN_MODES))
    return Descriptor(len(data), multiple=False, type=AnswerType.SAMPLERATE).encode() + data


def configuration(request: bytes) -> bytes:
    """Answer GET_LIDAR_CONF; the answer to what is unknown has nothing but the entry's number."""
    entry, number = struct.unpack("<IH", request[:6].ljust(6, b"\0"))
    data = struct.pack("<I", entry) + _value(entry, number)
    return Descriptor(len(data), multiple=False, type=AnswerType.LIDAR_CONF).encode() + data


def _value(entry: int, number: int) -> bytes:
    of_all: dict[int, bytes] = {
        Entry.COUNT: struct.pack("<H", len(SCAN_MODES)),
        Entry.TYPICAL: struct.pack("<H", SCAN_MODES.index(EXPRESS)),
    }
    if entry in of_all or number >= len(SCAN_MODES):
        return of_all.get(entry, b"")
    mode = SCAN_MODES[number]
    of_one: dict[int, bytes] = {
        Entry.US_PER_SAMPLE: struct.pack("<I", round(1e6 / mode.rate * _Q8)),
        Entry.MAX_DISTANCE: struct.pack("<I", round(FAR * _Q8)),
        Entry.ANSWER_TYPE: bytes([mode.answer]),
        Entry.NAME: mode.name.encode() + b"\0",
    }
    return of_one.get(entry, b"")
