"""Clients that never end what they begin, or never read: the router stays small, admits others and serves them."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import Event

import pytest
import zenoh

from contextpolicy.bus import session
from contextpolicy.bus.session import open_router, open_visitor
from tests.bus.deaf import deaf_client, without_shared_memory
from tests.bus.hearing import Heard
from tests.ports import free_port
from tests.waiting import PATIENCE, until

LARGEST = 1 << 20
FRAME, FRAMES = bytes(LARGEST - 1024), 10
"""Two senders of them fill all buffers between a router and a client that does not read."""
BLOCK = zenoh.CongestionControl.BLOCK


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


class Neighbours:
    """Two senders, whose messages to one client may take both threads on which a router reads, and a pair beside."""

    def __init__(self, port, sessions):
        self.senders, (self.speaker, listener) = self._open(2, port, sessions), self._open(2, port, sessions)
        self.heard = sessions.enter_context(Heard(listener, "robot/imu"))
        self.known, self.given_up = Event(), Event()
        listener.liveliness().declare_subscriber("robot/deaf", self._on_token, history=True)

    def _open(self, number, port, sessions):
        return [sessions.enter_context(without_shared_memory(port)) for _ in range(number)]

    def _on_token(self, token):
        (self.known if token.kind == zenoh.SampleKind.PUT else self.given_up).set()


def put(key):
    """Publish to the client."""

    def begin(client, senders, deaf, pool):
        client.declare_subscriber(key, lambda _: None)

        def flood(sender):
            deaf.wait(PATIENCE)
            for _ in range(FRAMES):
                sender.put(key, FRAME, congestion_control=BLOCK)

        return [pool.submit(flood, sender) for sender in senders]

    return begin


def query(client, senders, deaf, pool):
    """Query the client."""
    client.declare_queryable("robot/camera", lambda question: question.drop())

    def flood(sender):
        deaf.wait(PATIENCE)
        for _ in range(FRAMES):
            sender.get("robot/camera", lambda _: None, payload=FRAME, congestion_control=BLOCK)

    return [pool.submit(flood, sender) for sender in senders]


def reply(client, senders, deaf, pool):
    """Reply to the client's queries, which it sends before it stops to read."""

    def asked(sender, number):
        key = f"robot/camera/{number}"
        questions = sender.declare_queryable(key)
        with client.declare_querier(key) as querier:
            until(lambda: querier.matching_status.matching)
        client.get(key, lambda _: None, timeout=PATIENCE, congestion_control=BLOCK)
        return questions, questions.recv()

    def flood(questions, question):
        deaf.wait(PATIENCE)
        with questions, question:
            for _ in range(FRAMES):
                question.reply(question.key_expr, FRAME)

    received = [asked(sender, number) for number, sender in enumerate(senders)]
    return [pool.submit(flood, *one) for one in received]


FLOODS = {"samples": put("robot/camera"), "latched samples": put("robot/camera/@adv/pub/x"), "queries": query}


@pytest.fixture
def patient_router(port, monkeypatch):
    """It closes no connection during the test: if it waits for a client that does not read, the test fails."""
    monkeypatch.setattr(session, "CLOSE_AFTER", 2 * PATIENCE)
    with open_router([f"tcp/127.0.0.1:{port}"]):
        yield


@pytest.mark.usefixtures("patient_router")
@pytest.mark.parametrize("flood", [*FLOODS.values(), reply], ids=[*FLOODS, "replies"])
def test_a_client_that_does_not_read_delays_no_other_client(port, flood):
    """Queries, replies and latched topics made the router wait for it, and all others for the router, for 5 to 10 s.

    The router then gave it up, which it need not do if it does not wait for it.
    """
    with ThreadPoolExecutor(2) as pool, ExitStack() as sessions:  # closed sessions end floods that are held up
        neighbours = Neighbours(port, sessions)
        client, deaf = sessions.enter_context(deaf_client(port))
        floods = flood(client, neighbours.senders, deaf, pool)
        token = client.liveliness().declare_token("robot/deaf")  # it would end with the last reference
        assert neighbours.known.wait(PATIENCE)
        deaf.set()
        for running in floods:
            running.result(PATIENCE)
        neighbours.heard.until(neighbours.speaker, "robot/imu", "sample")
        assert not neighbours.given_up.is_set()
        del token
