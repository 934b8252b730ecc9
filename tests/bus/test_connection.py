"""A real router that ends, and another one: the session reports both by itself."""

from __future__ import annotations

import queue

from contextpolicy.bus.connection import Connection
from contextpolicy.bus.session import open_router, open_visitor
from tests.ports import free_port
from tests.waiting import PATIENCE


class News(queue.Queue[bool]):
    def on_connection(self, *, connected):
        self.put(connected)


def test_router_loss_and_return_are_detected():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    news = News()
    router = open_router([endpoint])
    with open_visitor([endpoint], patience=PATIENCE) as session:
        connection = Connection(session, news)
        while not news.get(timeout=PATIENCE):
            """Zenoh may report the transport only after the first look."""
        router.close()
        assert news.get(timeout=PATIENCE) is False
        with open_router([endpoint]):
            assert news.get(timeout=PATIENCE) is True
        connection.close()
