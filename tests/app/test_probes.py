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


def test_a_loop_that_answers_has_no_delay():
    assert Heartbeat(lambda beat: beat()).delay() == 0.0


def test_a_loop_that_hangs_is_measured_from_the_first_question_and_asked_only_once(monkeypatch):
    beats: list[Callable[[], None]] = []
    now = [100.0]
    monkeypatch.setattr("contextpolicy.app.probes.time.monotonic", lambda: now[0])
    pulse = Heartbeat(beats.append)
    pulse.delay()
    now[0] = 107.0
    assert pulse.delay() == 7.0
    assert len(beats) == 1
    beats[0]()
    now[0] = 108.0
    pulse.delay()
    assert len(beats) == 2


def test_one_question_that_hangs_holds_no_other_up():
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


def test_a_page_tells_every_problem():
    server = serve(0, {"/healthz": lambda: ["the loop hangs", "a watch has ended"]})
    assert get(server, "healthz") == (503, "the loop hangs\na watch has ended\n")
    assert get(server, "other")[0] == 404
    server.shutdown()
    server.server_close()
