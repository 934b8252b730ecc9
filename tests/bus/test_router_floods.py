"""Clients that never end what they begin: the router stays small, and admits others."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from contextpolicy.bus.session import open_router, open_visitor
from tests.bus.hearing import Heard
from tests.ports import free_port
from tests.waiting import PATIENCE

LARGEST = 1 << 20


@pytest.fixture
def port():
    return free_port()


@pytest.fixture
def router(port):
    arguments = ["router", f"--listen=tcp/127.0.0.1:{port}", f"--max-message-bytes={LARGEST}"]
    with subprocess.Popen(
        [sys.executable, "-m", "contextpolicy", *arguments], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("routing at")
        yield process
        process.terminate()


def peak(process):
    """Bytes of memory that it had at most."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
    [kib] = re.findall(r"VmHWM:\s*(\d+)", status)
    return int(kib) << 10


def test_oversized_message_does_not_grow_router_memory(router, port):
    with (
        open_visitor([f"tcp/127.0.0.1:{port}"], patience=PATIENCE) as listener,
        open_visitor([f"tcp/127.0.0.1:{port}"], patience=PATIENCE) as sender,
        Heard(listener, "robot/*") as heard,
    ):
        heard.until(sender, "robot/imu", "before")
        before = peak(router)
        with sender.declare_publisher("robot/imu", congestion_control=zenoh.CongestionControl.BLOCK) as publisher:
            publisher.put(bytes(200 << 20))
        heard.until(sender, "robot/imu", "after")
    assert peak(router) - before < 40 << 20


def test_silent_connections_do_not_block_clients(port):
    with open_router([f"tcp/127.0.0.1:{port}"]), ExitStack() as silent:
        for _ in range(150):
            silent.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))
        open_visitor([f"tcp/127.0.0.1:{port}"], patience=2.0).close()
