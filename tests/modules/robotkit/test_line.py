from __future__ import annotations

import os
import pty
import threading
from contextlib import suppress

import pytest

from robotkit import DeviceError
from robotkit.line import open_line
from robotkit.simulated import _listen, on_a_pseudo_terminal
from tests.ports import free_port
from tests.waiting import PATIENCE, until

BAUD = 115_200


class Echo:
    """A device that says back what it hears, and ticks."""

    period = 0.01

    def __init__(self):
        self.tick = b""

    def receive(self, data):
        return data

    def advance(self, seconds):
        del seconds
        return self.tick


def heard(line, size):
    found = b""
    while len(found) < size:
        data = line.read(PATIENCE)
        assert data
        found += data
    return found


def test_bytes_of_every_value_pass_unchanged():
    everything = bytes(range(256))
    with on_a_pseudo_terminal(Echo()) as port, open_line(port, BAUD) as line:
        line.write(everything)
        assert heard(line, 256) == everything


def test_reading_without_data_returns_empty_bytes():
    with on_a_pseudo_terminal(Echo()) as port, open_line(port, BAUD) as line:
        assert line.read(0) == b""


def test_a_device_serves_successive_users_unprompted():
    device = Echo()
    with on_a_pseudo_terminal(device) as port:
        for tick in (b"one", b"two"):
            with open_line(port, BAUD) as line:
                device.tick = tick
                while tick not in heard(line, 3):
                    pass


def test_a_device_has_one_user_at_a_time():
    with (
        on_a_pseudo_terminal(Echo()) as port,
        open_line(port, BAUD),
        pytest.raises(DeviceError, match="cannot be opened"),
    ):
        open_line(port, BAUD)


def test_a_device_that_is_unplugged_is_a_device_error_on_reading_and_writing():
    ours, theirs = pty.openpty()
    with open_line(os.ttyname(theirs), BAUD) as line:
        os.close(theirs)
        os.close(ours)
        with pytest.raises(DeviceError):
            line.read(PATIENCE)
        with pytest.raises(DeviceError):
            line.write(b"stop")


def test_a_closed_line_is_a_device_error():
    with on_a_pseudo_terminal(Echo()) as port:
        line = open_line(port, BAUD)
        line.close()
        with pytest.raises(DeviceError):
            line.read(0)


@pytest.mark.parametrize("wire", ["dtr", "rts"])
def test_setting_dtr_and_rts_on_a_pseudo_terminal_is_ignored(wire):
    with on_a_pseudo_terminal(Echo()) as port, open_line(port, BAUD) as line:
        line.set_wire(wire, on=True)
        line.write(b"data still pass")
        assert heard(line, 15) == b"data still pass"


def test_a_tcp_simulator_that_ends_is_a_device_error():
    port, stop = free_port(), threading.Event()
    ready = threading.Thread(target=_listen, args=(Echo(), port, stop))
    ready.start()
    line = connected(f"tcp://127.0.0.1:{port}")
    with line:
        line.write(b"hello")
        assert heard(line, 5) == b"hello"
        stop.set()
        ready.join(PATIENCE)
        with pytest.raises(DeviceError, match="device disconnected"):
            line.read(PATIENCE)


def connected(name):
    """A line to it, as soon as it listens."""
    lines = []

    def opened():
        with suppress(DeviceError):
            lines.append(open_line(name, BAUD))
        return lines

    until(opened)
    return lines[0]


@pytest.mark.parametrize("name", ["/dev/nowhere", "", "tcp://127.0.0.1:1", "tcp://", "tcp://127.0.0.1:x", "/dev/null"])
def test_an_invalid_device_is_reported_with_what_is_allowed(name):
    with pytest.raises(DeviceError, match="expected a device path or tcp://host:port"):
        open_line(name, BAUD)
