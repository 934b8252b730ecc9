"""A bus on 127.0.0.1 for tests: one router, clients that can reach nothing else, and bounded waits."""

from __future__ import annotations

import json
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import zenoh

from robotkit.session import client_config

PATIENCE_S = 10


@contextmanager
def router(port=None):
    address = f"tcp/127.0.0.1:{port or free_port()}"
    with zenoh.open(router_config(address)):
        yield address


def router_config(address, *, shared_memory=True):
    config = zenoh.Config()
    for key, value in (
        ("mode", "router"),
        ("scouting/multicast/enabled", False),
        ("listen/endpoints", [address]),
        ("transport/shared_memory/enabled", shared_memory),
    ):
        config.insert_json5(key, json.dumps(value))
    return config


@contextmanager
def client(address, *, shared_memory=False):
    with zenoh.open(client_config([address], shared_memory=shared_memory)) as session:
        yield session


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def soon(call):
    """Give the result of a call that blocks, or fail."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(call).result(PATIENCE_S)
    finally:
        pool.shutdown(wait=False)


class Matching:
    """Waits until someone listens to a publisher, or nobody does."""

    def __init__(self, publisher):
        self._now = publisher.matching_status.matching
        self._changed = threading.Condition()
        self._listener = publisher.declare_matching_listener(self._hear)

    def wait(self, expected):
        with self._changed:
            assert self._changed.wait_for(lambda: self._now == expected, PATIENCE_S)

    def _hear(self, status):
        with self._changed:
            self._now = status.matching
            self._changed.notify_all()
