"""A serial line to a device that may be unplugged at any moment; needs the extra `serial`."""

from __future__ import annotations

import os
import select
import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, Self
from urllib.parse import urlsplit

import serial

from robotkit.errors import DeviceError

if TYPE_CHECKING:
    from types import TracebackType

CHUNK = 4096
CONNECT_S = 1.0


class Line:
    """Bytes to and from a device; every failure is a DeviceError. Any thread may write."""

    def __init__(self, name: str, port: serial.Serial | socket.socket) -> None:
        self.name = name
        self._port = port
        self._fd: int = port.fileno()

    def read(self, timeout: float) -> bytes:
        """Wait at most `timeout` s and return the bytes that have arrived; empty when there are none."""
        try:
            if not select.select([self._fd], [], [], timeout)[0]:
                return b""
            data = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:  # ValueError: closed meanwhile
            raise DeviceError(f"{self.name}: {error}") from error
        if not data:
            raise DeviceError(f"{self.name}: device disconnected")
        return data

    def write(self, data: bytes) -> None:
        """Send everything in one write; a device that does not even accept a whole command counts as gone."""
        try:
            written = os.write(self._fd, data)
        except OSError as error:
            raise DeviceError(f"{self.name}: {error}") from error
        if written < len(data):
            raise DeviceError(f"{self.name}: the device accepts no more bytes")

    def set_wire(self, wire: Literal["dtr", "rts"], *, on: bool) -> None:
        """Assert or deassert a control line; does nothing where there is none (a pseudo-terminal, a socket)."""
        if isinstance(self._port, serial.Serial):
            with suppress(OSError):
                setattr(self._port, wire, on)

    def fileno(self) -> int:
        """Return the descriptor for `select`."""
        return self._fd

    def close(self) -> None:
        """Close the device."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def open_line(name: str, baud: int) -> Line:
    """Open a serial device such as /dev/ttyUSB0, exclusively, or `tcp://host:port`."""
    try:
        if name.startswith("tcp://"):
            return Line(name, _connect(name))
        return Line(name, serial.Serial(name, baud, exclusive=True))
    except (OSError, ValueError) as error:  # SerialException is an OSError
        raise DeviceError(f"{name!r} cannot be opened: expected a device path or tcp://host:port: {error}") from error


def _connect(name: str) -> socket.socket:
    address = urlsplit(name)
    connection = socket.create_connection((address.hostname or "", address.port or 0), CONNECT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.settimeout(0)
    return connection
