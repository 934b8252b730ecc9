"""What the kubelet's questions are answered with, while things hang."""

from __future__ import annotations

import threading
from http.client import HTTPConnection
from typing import TYPE_CHECKING

import pytest

from contextpolicy.app import probes
from contextpolicy.app.probes import Heartbeat, serve

if TYPE_CHECKING:
    from collections.abc import Callable


def get(server, page):
    connection = HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    try:
        connection.request("GET", f"/{page}")
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    monkeypatch.setattr(probes, "PATIENCE", 0.01)


class Loop:
    """Answers when the test has it answer."""

    def __init__(self) -> None:
        self.beats: list[Callable[[], None]] = []

    def submit(self, beat: Callable[[], None]) -> None:
        self.beats.append(beat)


class AnsweringLoop:
    def submit(self, beat: Callable[[], None]) -> None:
        beat()


def test_responsive_loop_has_no_delay():
    assert Heartbeat(AnsweringLoop()).delay() == 0.0


def test_a_hanging_loop_is_probed_once_and_measured_from_the_first_probe(monkeypatch):
    loop = Loop()
    now = [100.0]
    monkeypatch.setattr("contextpolicy.app.probes.time.monotonic", lambda: now[0])
    pulse = Heartbeat(loop)
    pulse.delay()
    now[0] = 107.0
    assert pulse.delay() == 7.0
    assert len(loop.beats) == 1
    loop.beats[0]()
    now[0] = 108.0
    pulse.delay()
    assert len(loop.beats) == 2


def test_hanging_check_does_not_block_other_endpoints():
    free = threading.Event()
    server = serve(0, {"/slow": lambda: [] if free.wait(20) else ["late"], "/quick": list})
    slow = threading.Thread(target=lambda: get(server, "slow"), daemon=True)
    slow.start()
    assert get(server, "quick") == (200, "ok\n")
    assert slow.is_alive()
    free.set()
    slow.join(20)
    server.shutdown()
    server.server_close()


def test_a_page_reports_every_problem():
    server = serve(0, {"/healthz": lambda: ["the loop hangs", "a watch has ended"]})
    assert get(server, "healthz") == (503, "the loop hangs\na watch has ended\n")
    assert get(server, "other")[0] == 404
    server.shutdown()
    server.server_close()
