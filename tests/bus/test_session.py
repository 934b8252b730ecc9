from __future__ import annotations

import json
import logging
import socket
from concurrent.futures import ThreadPoolExecutor
from queue import Queue
from threading import Event

import pytest
import zenoh

from contextpolicy.bus import session
from contextpolicy.bus.session import open_client, open_router, open_visitor
from tests.modules.robotkit.bus import Matching, ask
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
    assert f"no Zenoh router at {endpoint} yet: Timeout!" in caplog.text
    assert ".rs" not in caplog.text


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


def test_visitor_gives_up_after_its_patience(endpoint):
    with pytest.raises(zenoh.ZError):
        open_visitor([endpoint], patience=0.05)


def test_waiting_visitor_reconnects_often():
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
def test_invalid_endpoint_is_an_error():
    stop = Event()
    stop.set()
    assert open_client(["nonsense"], stop) is None
    with pytest.raises(zenoh.ZError):
        open_visitor(["nonsense"], patience=0.05)


def test_router_drops_oversized_messages():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    heard: Queue[tuple[str, int]] = Queue()
    with (
        open_router([endpoint], largest=500_000),
        open_visitor([endpoint], patience=PATIENCE) as listener,
        open_visitor([endpoint], patience=PATIENCE) as sender,
    ):
        for keys in ("**", "**/@adv/**"):
            listener.declare_subscriber(keys, lambda sample: heard.put((str(sample.key_expr), len(sample.payload))))
        publishers = [
            sender.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
            for key in ("robot/imu", "robot/map/@adv/x", "contextpolicy/agents/n1/confirmed")
        ]
        for publisher in publishers:
            Matching(publisher).wait(expected=True)
            for size in (600_000, 300_000, 100_000):
                publisher.put(b"x" * size)
        got = [heard.get(timeout=PATIENCE) for _ in range(5)]
    assert sorted(got) == [
        ("contextpolicy/agents/n1/confirmed", 100_000),
        ("robot/imu", 100_000),
        ("robot/imu", 300_000),
        ("robot/map/@adv/x", 100_000),
        ("robot/map/@adv/x", 300_000),
    ]
    assert heard.empty()


def test_a_router_waits_for_no_subscriber(endpoint):
    """A publisher that blocks when congested, as ROS nodes do, held up all others while one subscriber did not read."""
    heard: Queue[zenoh.Sample] = Queue()
    with (
        open_router([endpoint]),
        open_visitor([endpoint], patience=PATIENCE) as listener,
        open_visitor([endpoint], patience=PATIENCE) as sender,
    ):
        listener.declare_subscriber("robot/camera", heard.put)
        publisher = sender.declare_publisher("robot/camera", congestion_control=zenoh.CongestionControl.BLOCK)
        Matching(publisher).wait(expected=True)
        publisher.put("frame")
        assert heard.get(timeout=PATIENCE).congestion_control == zenoh.CongestionControl.DROP


def test_router_ends_queries_that_carry_much_to_operators_and_agents(endpoint):
    """Only those on contextpolicy/agents/** were bounded, which wildcards avoid, and by 256 KiB."""
    node = "contextpolicy/agents/n1"
    with (
        open_router([endpoint]),
        open_visitor([endpoint], patience=PATIENCE) as agent,
        open_visitor([endpoint], patience=PATIENCE) as viewer,
        agent.declare_queryable(node, lambda query: query.reply(node, "report")),
    ):
        assert ask(viewer, node) == ["report"]
        for size, answers in ((4096, 1), (4097, 0)):
            assert len(list(viewer.get("contextpolicy/*/n1", payload=bytes(size), timeout=PATIENCE))) == answers


def test_a_router_does_not_wait_long_for_who_does_not_read_declarations():
    """Zenoh never drops those: it waits, 5 s by default, and then closes the session."""
    waits = session._config(session._router([])).get_json("transport/link/tx/queue/congestion_control/block")
    assert json.loads(waits) == {"wait_before_close": 250_000}


def test_a_router_routes_as_soon_as_it_listens():
    """For 0.5 s it let clients in before it said so: one that was killed then counted as one that never routed."""
    assert json.loads(session._config(session._router(["tcp/127.0.0.1:0"])).get_json("scouting/delay")) == 0
