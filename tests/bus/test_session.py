from __future__ import annotations

import json
import logging
import socket
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest
import zenoh

from contextpolicy.bus import session
from contextpolicy.bus.session import open_client, open_router, open_visitor
from tests.ports import free_port
from tests.waiting import PATIENCE


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(session, "ATTEMPT", 0.05)
    monkeypatch.setattr(session, "PAUSE", 0.05)


def test_every_queue_is_as_long_as_zenoh_allows():
    """In its default of two messages, two cores that are busy with 30 pods lost 3 % of 200 samples a second."""
    sizes = json.loads(session._config({}).get_json("transport/link/tx/queue/size"))
    assert set(sizes.values()) == {session.QUEUE}


@pytest.mark.usefixtures("quick")
def test_a_client_waits_for_its_router(endpoint, caplog):
    missed = Event()

    class Notice(logging.Handler):
        def emit(self, record):  # noqa: ARG002 - logging's signature
            missed.set()

    with ThreadPoolExecutor(1) as pool:
        logging.getLogger(session.__name__).addHandler(notice := Notice())
        waiting = pool.submit(open_client, [endpoint], Event())
        assert missed.wait(PATIENCE)
        assert not waiting.done()
        with open_router([endpoint]):
            client = waiting.result(PATIENCE)
            assert client is not None
            client.close()
        logging.getLogger(session.__name__).removeHandler(notice)
    assert f"no Zenoh router at {endpoint} yet" in caplog.text


def test_a_slow_handshake_gets_more_time_with_each_attempt(monkeypatch):
    """All attempts took a second at most: a board that needs longer for TLS might never have had a session."""
    given: list[float] = []
    session_at_last = object()

    def slow(*_, patience, **__):
        given.append(patience)
        if len(given) < 6:
            raise zenoh.ZError
        return session_at_last

    monkeypatch.setattr(session, "open_visitor", slow)
    monkeypatch.setattr(session, "PAUSE", 0)
    assert open_client(["tls/router:7447"], Event()) is session_at_last
    assert given == [0.5, 1, 2, 4, 4, 4]


@pytest.mark.usefixtures("quick")
def test_a_wait_for_a_router_can_be_ended(endpoint):
    stop = Event()
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(open_client, [endpoint], stop)
        stop.set()
        assert waiting.result(PATIENCE) is None


def test_a_visitor_does_not_wait_longer_than_it_has_patience(endpoint):
    with pytest.raises(zenoh.ZError):
        open_visitor([endpoint], patience=0.05)


def test_a_visitor_that_waits_knocks_often():
    """After Zenoh's default of 1, 2 and 4 s, a robot that was switched on waited for a router that was there."""
    with socket.create_server(("127.0.0.1", 0)) as door, ThreadPoolExecutor(1) as pool:
        door.settimeout(PATIENCE)
        visitor = pool.submit(open_visitor, [f"tcp/127.0.0.1:{door.getsockname()[1]}"], patience=3)
        for _ in range(5):
            door.accept()[0].close()
            assert not visitor.done()
        with pytest.raises(zenoh.ZError):
            visitor.result(PATIENCE)


@pytest.mark.usefixtures("quick")
def test_an_endpoint_that_is_none_is_an_error_and_no_crash():
    stop = Event()
    stop.set()
    assert open_client(["nonsense"], stop) is None
    with pytest.raises(zenoh.ZError):
        open_visitor(["nonsense"], patience=0.05)
