"""A bus on 127.0.0.1 for tests: one router, clients that can reach nothing else, and bounded waits."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from queue import Queue

import zenoh

from contextpolicy.bus.session import PRIORITIES, QUEUE
from robotkit.session import client_config
from tests.ports import free_port
from tests.waiting import PATIENCE, until


@contextmanager
def router(port=None):
    address = f"tcp/127.0.0.1:{port or free_port()}"
    with zenoh.open(router_config(address)):
        yield address


def router_config(address, *, shared_memory=True):
    """Queues as long as those of the product's router: with Zenoh's own, a busy machine loses messages."""
    config = zenoh.Config()
    for key, value in (
        ("mode", "router"),
        ("scouting/multicast/enabled", False),
        ("listen/endpoints", [address]),
        ("transport/shared_memory/enabled", shared_memory),
        *((f"transport/link/tx/queue/size/{priority}", QUEUE) for priority in PRIORITIES),
    ):
        config.insert_json5(key, json.dumps(value))
    return config


@contextmanager
def client(address, *, shared_memory=False):
    with zenoh.open(client_config([address], shared_memory=shared_memory)) as session:
        yield session


def ask(session, key):
    """The answers, as texts, as soon as the router knows who gives them."""
    answers: list[str] = []

    def answered():
        answers[:] = [reply.ok.payload.to_string() for reply in session.get(key, timeout=PATIENCE) if reply.ok]
        return answers

    until(answered)
    return answers


def soon(call):
    """Give the result of a call that blocks, or fail."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(call).result(PATIENCE)
    finally:
        pool.shutdown(wait=False)


class Matching:
    """Waits until someone listens to a publisher, or nobody does; a change is not missed, however short it was."""

    def __init__(self, publisher):
        self._now = False
        self._changes: Queue[bool] = Queue()
        self._listener = publisher.declare_matching_listener(lambda status: self._changes.put(status.matching))

    def wait(self, expected):
        while self._now != expected:
            self._now = self._changes.get(timeout=PATIENCE)
