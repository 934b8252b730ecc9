"""/metrics is open to anybody in the cluster: who asks without pause gets little of the process's CPU."""

from __future__ import annotations

import socket
import time
from contextlib import contextmanager
from http import HTTPStatus
from select import select
from threading import Event, Thread
from urllib.request import urlopen

import pytest
from prometheus_client import REGISTRY, Metric

from contextpolicy.agent.service import serve as serve_agent
from contextpolicy.bus import http_server
from contextpolicy.bus.http_places import AT_ONCE, PER_ADDRESS
from contextpolicy.bus.metrics_page import MetricsPage, PageTurns
from contextpolicy.bus.questions import REST
from contextpolicy.telemetry.metrics_server import serve_metrics
from tests.waiting import PATIENCE, until


def test_each_turn_is_followed_by_a_rest():
    now = [0.0]
    turns = PageTurns(lambda: now[0])
    assert turns.pause == 0
    with turns.take():
        now[0] += 2.0
    assert turns.pause == 2.0 * REST
    now[0] += 5.0
    assert turns.pause == 2.0 * REST - 5.0


def test_one_turn_is_taken_at_a_time():
    turns, inside, counts = PageTurns(lambda: 0.0), [], []

    def several() -> None:
        for _ in range(50):
            with turns.take():
                inside.append(1)
                time.sleep(0)  # another thread's turn to run
                counts.append(len(inside))
                inside.pop()

    threads = [Thread(target=several) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert counts == [1] * 200


class Watching:
    """A collector that says whether a turn was taken for the page."""

    taken = False

    def __init__(self) -> None:
        self.pages: list[bool] = []

    @contextmanager
    def take(self):
        self.taken = True
        yield
        self.taken = False

    def describe(self):
        return []

    def collect(self):
        self.pages.append(self.taken)
        return []


@pytest.fixture
def watching(monkeypatch):
    collector = Watching()
    monkeypatch.setattr(MetricsPage, "turns", collector)
    REGISTRY.register(collector)
    yield collector
    REGISTRY.unregister(collector)


@pytest.mark.parametrize("serve", [serve_metrics, lambda port: serve_agent(port, lambda: True)])
def test_a_page_is_made_in_a_turn(watching, serve):
    with urlopen(f"http://127.0.0.1:{serve(0)}/metrics", timeout=PATIENCE) as page:
        assert b"process_cpu_seconds_total" in page.read()
    assert watching.pages == [True]


class Long:
    """A collector of more than a connection holds on the way."""

    def describe(self):
        return []

    def collect(self):
        return [Metric("long", "x" * (16 << 20), "gauge")]


@pytest.fixture
def long():
    collector = Long()
    REGISTRY.register(collector)
    yield
    REGISTRY.unregister(collector)


@pytest.mark.usefixtures("long")
def test_a_scraper_that_does_not_read_keeps_no_other_waiting(monkeypatch):
    monkeypatch.setattr(http_server, "PATIENCE", 2 * PATIENCE)  # it is not given up meanwhile
    port = serve_metrics(0)
    with socket.create_connection(("127.0.0.1", port)) as deaf:
        deaf.sendall(b"GET /metrics HTTP/1.1\r\n\r\n")
        assert deaf.recv(1) == b"H"
        with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE) as page:
            assert page.status == 200


class Standing:
    """Turns that nobody gets for now."""

    def __init__(self) -> None:
        self.go_on = Event()

    @contextmanager
    def take(self):
        self.go_on.wait(PATIENCE)
        yield


def ask(port, address, path="/metrics"):
    client = socket.create_connection(("127.0.0.1", port), PATIENCE, source_address=(address, 0))
    client.sendall(f"GET {path} HTTP/1.1\r\n\r\n".encode())
    return client


def status(client):
    with client:
        return HTTPStatus(int(client.recv(1 << 16).split()[1]))


def test_clients_that_wait_for_pages_leave_places_for_a_probe(monkeypatch):
    """Two pods that asked without pause had the kubelet restart the agent, whose probes come to the same port."""
    turns = Standing()
    monkeypatch.setattr(MetricsPage, "turns", turns)
    port = serve_agent(0, lambda: True)
    clients = [ask(port, address) for address in ("127.0.0.2", "127.0.0.3") for _ in range(PER_ADDRESS)]
    sent_away = AT_ONCE // 4
    until(lambda: len(select(clients, [], [], 0)[0]) == sent_away)
    assert status(ask(port, "127.0.0.1", "/healthz")) is HTTPStatus.OK
    turns.go_on.set()
    statuses = sorted(map(status, clients))
    assert statuses == [HTTPStatus.OK] * (AT_ONCE - sent_away) + [HTTPStatus.SERVICE_UNAVAILABLE] * sent_away
