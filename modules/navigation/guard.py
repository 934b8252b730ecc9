"""`python -m modules.navigation.guard`: hold the robot's serial port, and stop its wheels without a controller.

The Create 2 has no watchdog: its wheels keep the last speed until it receives another. So the port belongs to this
small process, which has CPU of its own, and navigation steers through it. The wheels are stopped when the controller
sends nothing for `PATIENCE` (killed, frozen, starved of CPU), when its connection ends, and when the guard starts or
stops. Only complete commands from a short list pass: nobody can leave the robot waiting for the rest of a command,
or enter Full mode, in which it drives off cliffs.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from modules.navigation import open_interface as oi
from modules.navigation.open_interface import CommandParser, Opcode
from robotkit import DeviceError
from robotkit.line import open_line

if TYPE_CHECKING:
    from robotkit.line import Line

PORT = 4100
ADDRESS = f"tcp://127.0.0.1:{PORT}"
PATIENCE = 0.5
RETRY_S = 0.5
CHUNK = 4096
PASSED = {
    *(Opcode.START, Opcode.SAFE, Opcode.STOP, Opcode.DRIVE_DIRECT),
    *(Opcode.SENSORS, Opcode.QUERY_LIST, Opcode.STREAM, Opcode.PAUSE_RESUME_STREAM),
}
WAKE_EVERY, WAKE_S = 60.0, 1.0
"""A robot in Passive mode falls asleep after five minutes unless its BRC pin is held low once in a while."""
END = oi.HALT + oi.pause_stream()
"""Sent on behalf of a controller that is gone."""

_LOG = logging.getLogger(__name__)


class Watch:
    """Filters the controller's commands and notices its silence. Pure: time is an argument, in s."""

    def __init__(self) -> None:
        self._parser = CommandParser()
        self._moving = False
        self._heard = 0.0

    def hear(self, data: bytes, now: float) -> bytes:
        """Return the part of the controller's commands that may pass."""
        passed = b""
        for command in self._parser.feed(data):
            if command.opcode not in PASSED:
                _LOG.warning("command %s is not allowed: dropped", command.opcode.name)
                continue
            passed += command.encode()
            if command.opcode is Opcode.DRIVE_DIRECT:
                self._moving, self._heard = any(command.arguments), now
        return passed

    def patience(self, now: float) -> float | None:
        """Return how long to wait for the controller, in s; None (forever) while the wheels stand still."""
        return max(self._heard + PATIENCE - now, 0.0) if self._moving else None

    def lost(self, now: float) -> bool:
        """Return True, once, when the wheels turn and the controller has been silent for PATIENCE."""
        lost = self.patience(now) == 0
        self._moving = self._moving and not lost
        return lost


def brc_low(now: float) -> tuple[bool, float]:
    """Return whether to hold the robot's BRC pin low, and for how many seconds that holds."""
    phase = now % WAKE_EVERY
    return (True, WAKE_S - phase) if phase < WAKE_S else (False, WAKE_EVERY - phase)


class Guard:
    """Passes bytes between one controller and the robot."""

    def __init__(self, server: socket.socket, stop: threading.Event) -> None:
        self._server = server
        self._stop = stop
        self._woken, self._waker = os.pipe()

    def wake(self) -> None:
        """End; allowed on any thread."""
        self._stop.set()
        os.write(self._waker, b"!")

    def run(self, port: str) -> None:
        """Guard the robot until the end; a robot that is unplugged is looked for twice a second."""
        while not self._stop.is_set():
            try:
                with open_line(port, oi.BAUD) as line:
                    line.write(oi.RESYNC + END)
                    _LOG.info("%s: wheels stopped", port)
                    self._guard(line)
            except DeviceError as error:
                _LOG.warning("%s", error)
                self._stop.wait(RETRY_S)

    def _guard(self, line: Line) -> None:
        try:
            while not self._stop.is_set():
                ready = self._wait(line, self._server, None)
                if line.fileno() in ready:
                    line.read(0)
                if self._server.fileno() in ready:
                    controller, _ = self._server.accept()
                    with controller:
                        controller.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        controller.settimeout(0)
                        self._pass_on(line, controller)
        finally:
            with suppress(DeviceError):
                line.write(END)

    def _wait(self, line: Line, other: socket.socket, patience: float | None) -> list[int]:
        """Wait and return the descriptors with data, keeping the robot awake meanwhile."""
        low, lasts = brc_low(time.monotonic())
        line.set_wire("rts", on=low)
        timeout = lasts if patience is None else min(lasts, patience)
        return select.select([other.fileno(), line.fileno(), self._woken], [], [], timeout)[0]

    def _pass_on(self, line: Line, controller: socket.socket) -> None:
        watch = Watch()
        while not self._stop.is_set():
            ready = self._wait(line, controller, watch.patience(time.monotonic()))
            if controller.fileno() in ready:
                data = _received(controller)
                if not data:
                    line.write(END)
                    _LOG.info("controller disconnected: wheels stopped")
                    return
                line.write(watch.hear(data, time.monotonic()))
            if line.fileno() in ready:
                _send(controller, line.read(0))
            if watch.lost(time.monotonic()):
                line.write(oi.HALT)
                _LOG.warning("no data from the controller for %g s: wheels stopped", PATIENCE)


def _received(controller: socket.socket) -> bytes:
    try:
        return controller.recv(CHUNK)
    except OSError:  # reset by a controller that was killed
        return b""


def _send(controller: socket.socket, data: bytes) -> None:
    with suppress(OSError):  # too slow: the frames have checksums, the next ones will do
        controller.send(data)


def main() -> None:
    """Run as a program until SIGTERM or SIGINT."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s guard: %(message)s")
    port, listen = os.environ.get("ROBOT_PORT", "/dev/ttyUSB0"), os.environ.get("GUARD_PORT", str(PORT))
    if not listen.isdecimal() or int(listen) not in range(1, 65536):
        sys.exit(f"GUARD_PORT: invalid value {listen!r}: expected a port from 1 to 65535")
    with socket.create_server(("127.0.0.1", int(listen))) as server:
        guard = Guard(server, threading.Event())
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: guard.wake())
        guard.run(port)


if __name__ == "__main__":
    main()
