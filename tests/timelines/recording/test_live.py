"""The bus for Foxglove, as a program: a WebSocket that names the topics that it has heard."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from contextlib import suppress
from urllib.parse import urlsplit

import pytest

from tests.modules.robotkit.bus import client, router
from tests.waiting import PATIENCE, until

UPGRADE = (
    "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)


@pytest.fixture
def viewed():
    """A bus, and the socket of a viewer beside it."""
    with router() as address, client(address) as sensor:
        program = [sys.executable, "-m", "timelines.recording.live", "--connect", address, "--port", "0"]
        with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None
            port = urlsplit(running.stdout.readline().strip()).port
            with socket.create_connection(("localhost", port), timeout=0.1) as viewer:
                viewer.sendall(UPGRADE.encode())
                yield sensor, viewer
            running.terminate()
            assert running.wait(PATIENCE) == 0


def test_a_viewer_receives_topics_as_they_appear(viewed):
    sensor, viewer = viewed
    heard = b""

    def names_it():
        nonlocal heard
        sensor.put("robot/imu", json.dumps({"speed": 0.3}))
        with suppress(TimeoutError):
            heard += viewer.recv(65536)
        return b'"topic":"robot/imu"' in heard

    until(names_it)
    assert heard.startswith(b"HTTP/1.1 101")


def test_a_missing_router_address_is_reported():
    program = [sys.executable, "-m", "timelines.recording.live", "--connect", ""]
    ended = subprocess.run(program, capture_output=True, text=True, timeout=2 * PATIENCE, check=False)
    assert ended.returncode == 2
    assert "ZENOH_CONNECT" in ended.stderr
