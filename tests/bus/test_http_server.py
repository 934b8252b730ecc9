"""Strangers at each of our HTTP servers: what they send without end, or never, takes nothing from anybody else."""

from __future__ import annotations

import socket
import threading
from http.client import HTTPConnection
from typing import Any

import pytest

from contextpolicy.agent.service import serve as serve_agent
from contextpolicy.app.probes import serve as serve_probes
from contextpolicy.bus import http_server
from contextpolicy.bus.http_places import AT_ONCE, PER_ADDRESS
from contextpolicy.bus.http_server import LONGEST
from contextpolicy.live.page_server import PageServer
from contextpolicy.telemetry.metrics_server import serve_metrics
from tests.waiting import PATIENCE, until


class Operator:
    def boards(self):
        return []


def page():
    watched: Any = Operator()
    server = PageServer(0, watched)
    server.start()
    return server.server_port


SERVERS = {
    "health": lambda: (serve_probes(0, {"/healthz": list}).server_port, "/healthz"),
    "metrics": lambda: (serve_metrics(0), "/metrics"),
    "agent": lambda: (serve_agent(0, lambda: True), "/healthz"),
    "live page": lambda: (page(), "/api/boards"),
}


@pytest.fixture(params=SERVERS)
def served(request):
    return SERVERS[request.param]()


def connect(port, address="127.0.0.1"):
    return socket.create_connection(("127.0.0.1", port), PATIENCE, source_address=(address, 0))


def get(port, path, address="127.0.0.1"):
    connection = HTTPConnection("127.0.0.1", port, timeout=PATIENCE, source_address=(address, 0))
    connection.request("GET", path)
    status = connection.getresponse().status
    connection.close()
    return status


def is_closed(client):
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def threads():
    return sum("process_request_thread" in thread.name for thread in threading.enumerate())


@pytest.mark.parametrize("begun", [b"GET /" + b"x" * LONGEST, b"GET / HTTP/1.1\r\nX: " + b"a" * LONGEST])
def test_endless_request_is_closed(served, begun):
    port, path = served
    with connect(port) as client:
        client.sendall(begun)
        assert is_closed(client)
    assert get(port, path) == 200


def test_the_longest_request_is_answered(served):
    port, path = served
    begun = f"GET {path} HTTP/1.0\r\nHost: localhost\r\nX: ".encode()
    with connect(port) as client:
        client.sendall(begun + b"a" * (LONGEST - len(begun) - 4) + b"\r\n\r\n")
        assert client.recv(12).endswith(b" 200")


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\n"])
def test_incomplete_request_times_out(served, begun, monkeypatch):
    monkeypatch.setattr(http_server, "PATIENCE", 0.01)
    with connect(served[0]) as client:
        client.sendall(begun)
        assert is_closed(client)


def test_slow_dripping_request_times_out(served, monkeypatch):
    monkeypatch.setattr(http_server, "PATIENCE", 0.2)
    with connect(served[0]) as client:
        ended = threading.Event()

        def drip():
            while not ended.wait(0.02):
                client.send(b"G")

        dripping = threading.Thread(target=drip, daemon=True)
        dripping.start()
        assert is_closed(client)
        ended.set()
        dripping.join(PATIENCE)


def test_bodies_are_not_read(served):
    port, path = served
    with connect(port) as client:
        client.sendall(f"GET {path} HTTP/1.0\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\nx".encode())
        assert client.recv(12).endswith(b" 200")


def test_flood_from_one_address_does_not_block_others(served):
    port, path = served
    before = threads()
    flood = [connect(port, "127.0.0.2") for _ in range(100)]
    for client in flood:
        client.sendall(b"GET / HTTP/1.1\r\n")
    assert [get(port, path) for _ in range(20)] == [200] * 20
    until(lambda: threads() - before <= PER_ADDRESS)
    assert [is_closed(client) for client in flood[:-PER_ADDRESS]] == [True] * (100 - PER_ADDRESS)
    for client in flood:
        client.close()


def test_flood_from_many_addresses_does_not_block_others(served):
    port, path = served
    before = threads()
    flood = [connect(port, f"127.0.1.{1 + number}") for number in range(100)]
    assert [get(port, path) for _ in range(20)] == [200] * 20
    until(lambda: threads() - before <= AT_ONCE)
    for client in flood:
        client.close()
