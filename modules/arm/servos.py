"""Commands of a Pololu Maestro servo controller, to which the MeArm's four servos are wired.

Source: Pololu Maestro Servo Controller User's Guide, sections 4.e and 5. Compact protocol with CRC-7 (`Enable CRC`
must be set in the Maestro), so that a corrupted byte moves no servo. Pulses are in quarter microseconds; a speed of 1
is a quarter microsecond per 10 ms, and 0 means no limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

BAUD = 115_200
QUARTERS = 4
"""Units per microsecond."""
MAX_VALUE = (1 << 14) - 1
_POLYNOMIAL = 0x91


class Opcode(IntEnum):
    """The commands that the arm needs."""

    SET_TARGET = 0x84
    SET_SPEED = 0x87
    SET_ACCELERATION = 0x89
    GET_POSITION = 0x90
    GET_ERRORS = 0xA1
    GO_HOME = 0xA2


class ErrorBit(IntEnum):
    """Bits of the answer to GET_ERRORS."""

    SIGNAL = 0
    OVERRUN = 1
    BUFFER_FULL = 2
    CRC = 3
    PROTOCOL = 4
    TIMEOUT = 5


_CHANNEL_AND_VALUE = {Opcode.SET_TARGET, Opcode.SET_SPEED, Opcode.SET_ACCELERATION}


def crc7(data: bytes) -> int:
    """Return the remainder that the Maestro expects as the last byte."""
    remainder = 0
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            remainder = (remainder ^ _POLYNOMIAL if remainder & 1 else remainder) >> 1
    return remainder


@dataclass(frozen=True, slots=True)
class Command:
    """One command; a field that its opcode has no use for is 0."""

    opcode: Opcode
    channel: int = 0
    value: int = 0

    def encode(self) -> bytes:
        """Return the bytes with their CRC."""
        body = bytes([self.opcode])
        if self.opcode in _CHANNEL_AND_VALUE:
            body += bytes([self.channel, self.value & 0x7F, self.value >> 7])
        elif self.opcode is Opcode.GET_POSITION:
            body += bytes([self.channel])
        return body + bytes([crc7(body)])


def set_target(channel: int, pulse_us: float) -> bytes:
    """Move a servo to where a pulse of this length sends it; 0 ends the pulses, and the servo goes limp."""
    return _with_value(Opcode.SET_TARGET, channel, round(pulse_us * QUARTERS))


def set_speed(channel: int, us_per_s: float) -> bytes:
    """Let a servo's pulse change no faster; the least limit is 25 us/s, since 0 would mean none."""
    return _with_value(Opcode.SET_SPEED, channel, max(int(us_per_s * QUARTERS / 100), 1))


def get_position(channel: int) -> bytes:
    """Ask for the pulse that is being sent: two bytes, the low one first."""
    return Command(Opcode.GET_POSITION, channel).encode()


GET_ERRORS = Command(Opcode.GET_ERRORS).encode()
GO_HOME = Command(Opcode.GO_HOME).encode()


def _with_value(opcode: Opcode, channel: int, value: int) -> bytes:
    if not 0 <= value <= MAX_VALUE:
        raise ValueError(
            f"{opcode.name.lower()} of channel {channel}: invalid value {value}: expected 0 to {MAX_VALUE}"
        )
    return Command(opcode, channel, value).encode()


class CommandParser:
    """The Maestro's side: commands from bytes in pieces of any size, and error bits for invalid ones."""

    def __init__(self) -> None:
        self.errors = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Command]:
        """Take the next bytes; a new command byte interrupts an unfinished command, as in the Maestro."""
        commands = []
        for byte in data:
            if byte & 0x80:
                self._note(ErrorBit.PROTOCOL, when=bool(self._buffer))
                self._buffer = bytearray([byte])
            elif self._buffer:
                self._buffer.append(byte)
            else:
                self._note(ErrorBit.PROTOCOL)
            if self._buffer and len(self._buffer) == self._size():
                commands += self._complete()
        return commands

    def take_errors(self) -> int:
        """Return the error bits and forget them."""
        errors, self.errors = self.errors, 0
        return errors

    def _size(self) -> int:
        try:
            opcode = Opcode(self._buffer[0])
        except ValueError:
            self._note(ErrorBit.PROTOCOL)
            self._buffer.clear()
            return -1
        return 5 if opcode in _CHANNEL_AND_VALUE else 3 if opcode is Opcode.GET_POSITION else 2

    def _complete(self) -> list[Command]:
        packet, self._buffer = bytes(self._buffer), bytearray()
        if crc7(packet[:-1]) != packet[-1]:
            self._note(ErrorBit.CRC)
            return []
        opcode = Opcode(packet[0])
        if opcode in _CHANNEL_AND_VALUE:
            return [Command(opcode, packet[1], packet[2] | packet[3] << 7)]
        return [Command(opcode, packet[1] if opcode is Opcode.GET_POSITION else 0)]

    def _note(self, error: ErrorBit, *, when: bool = True) -> None:
        self.errors |= when << error
