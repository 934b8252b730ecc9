"""Serves a simulated device where the real one would be: on a pseudo-terminal, or on a TCP port for another pod."""

from __future__ import annotations

import argparse
import os
import pty
import select
import socket
import threading
import time
import tty
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from robotkit.termination import stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Iterator

CHUNK = 4096
LONGEST_STEP_S = 0.1
"""On a busy machine a device falls behind instead of sending more at once than its line can hold."""


class Device(Protocol):
    """A device as its data sheet describes it; it has no clock and is given the time that has passed."""

    period: float
    """Seconds between two calls of `advance`."""

    def receive(self, data: bytes) -> bytes:
        """Take bytes and return the device's answer."""

    def advance(self, seconds: float) -> bytes:
        """Let time pass and return what the device sends unasked."""


def serve(device: Device, fd: int, stop: threading.Event) -> None:
    """Act as the device on `fd` until `stop` is set or the other side closes for good."""
    then = time.monotonic()
    while not stop.is_set():
        try:
            if select.select([fd], [], [], device.period)[0]:
                data = os.read(fd, CHUNK)
                if not data:
                    return
                _send(fd, device.receive(data))
        except OSError:  # a pseudo-terminal gives EIO while nobody has the other end open
            stop.wait(device.period)
        now = time.monotonic()
        if now - then >= device.period:
            _send(fd, device.advance(min(now - then, LONGEST_STEP_S)))
            then = now


def _send(fd: int, data: bytes) -> None:
    try:
        os.write(fd, data)
    except OSError:  # nobody listens, or too slowly: a UART loses bytes as well
        return


@contextmanager
def on_a_pseudo_terminal(device: Device) -> Iterator[str]:
    """Serve the device on a thread; yields the path to use as its serial port."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(device, ours, stop), name="device", daemon=True)
    thread.start()
    try:
        yield os.ttyname(theirs)  # we keep it open ourselves, so the device sees no hang-up between two users
    finally:
        stop.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


def main(device: Device, name: str) -> None:
    """Run a simulator as a program until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(description=f"a simulated {name}")
    parser.add_argument("--link", type=Path, help="also make this link to the pseudo-terminal")
    parser.add_argument("--listen", metavar="PORT", type=int, help="serve on 127.0.0.1:PORT instead")
    arguments = parser.parse_args()
    stop = stop_on_signals()
    if arguments.listen is not None:
        _listen(device, arguments.listen, stop)
        return
    with on_a_pseudo_terminal(device) as path:
        if arguments.link is not None:
            arguments.link.unlink(missing_ok=True)
            arguments.link.symlink_to(path)
        print(path, flush=True)  # noqa: T201 - the caller reads it
        stop.wait()


def _listen(device: Device, port: int, stop: threading.Event) -> None:
    with socket.create_server(("127.0.0.1", port)) as server:
        server.settimeout(device.period)
        then = time.monotonic()
        while not stop.is_set():
            try:
                connection, _ = server.accept()
            except TimeoutError:
                now = time.monotonic()
                device.advance(min(now - then, LONGEST_STEP_S))  # a robot does not stop because nobody listens
                then = now
                continue
            with connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connection.settimeout(0)
                serve(device, connection.fileno(), stop)
            then = time.monotonic()
