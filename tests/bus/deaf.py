"""A client that stays connected to a router and reads nothing."""

from __future__ import annotations

import select
import socket
from contextlib import contextmanager, suppress
from threading import Event, Thread

import zenoh

from contextpolicy.bus.session import _config

HOUR_MS = 3_600_000


def without_shared_memory(port, **settings):
    """A client whose messages all take the network, as between pods."""
    endpoint = {"mode": "client", "connect/endpoints": [f"tcp/127.0.0.1:{port}"]}
    return zenoh.open(_config({**endpoint, "transport/shared_memory/enabled": False, **settings}))


@contextmanager
def deaf_client(port):
    """The client, and an event that makes it deaf once it is set; its router gives it an hour to say something."""
    relay = _Relay(port)
    try:
        with without_shared_memory(relay.port, **{"transport/link/tx/lease": HOUR_MS}) as client:
            yield client, relay.deaf
            relay.close()
    finally:
        relay.close()


class _Relay:
    """Between a client and its router; nothing passes it any more once it is deaf, and no connection is closed."""

    def __init__(self, port):
        self.deaf = Event()
        self._router, self._door = ("127.0.0.1", port), socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        self._ends: list[socket.socket] = []
        Thread(target=self._serve, daemon=True).start()

    def close(self):
        for end in (self._door, *self._ends):
            end.close()

    def _serve(self):
        with suppress(OSError, ValueError):  # it is closed
            client, _ = self._door.accept()
            router = socket.create_connection(self._router)
            # Left alone, the receive buffer may grow to 32 MiB, more than the tests send.
            router.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
            self._ends = [client, router]
            other = {client: router, router: client}
            while not self.deaf.is_set():
                for end in select.select([client, router], [], [], 0.01)[0]:
                    other[end].sendall(end.recv(1 << 16))
