"""The base of all our HTTP servers: whatever clients send or hold back takes little memory and blocks no other client.

A request is its request line and headers, of bounded length, within a bounded time; bodies are never read.
"""

from __future__ import annotations

import logging
import socket
import sys
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from threading import Lock, Thread
from typing import Any

from contextpolicy.bus.http_places import Places
from contextpolicy.bus.listening import DualStack

log = logging.getLogger(__name__)

LONGEST = 8 << 10
"""Bytes of a request."""
PATIENCE = 5.0
"""Seconds within which a whole request has to come, and the whole answer has to be taken."""
END = b"\r\n\r\n"


class HttpServer(DualStack, ThreadingHTTPServer):
    """Answers each connection on a thread of its own, as many as `http_places` allows."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, address: tuple[str, int], handler: type[HttpHandler], name: str) -> None:
        self._places: Places[socket.socket] = Places()
        self._lock, self._name = Lock(), name
        super().__init__(address, handler)

    def start(self) -> None:
        """Serve on a thread of its own, until closed."""
        Thread(target=self.serve_forever, name=self._name, daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a new connection, if it gets a place."""
        with self._lock:
            closed = self._places.enter(request, client_address[0])
            if closed is not None:
                with suppress(OSError):  # its thread ends at once, and closes it
                    closed.shutdown(socket.SHUT_RDWR)
        refused = closed is request
        if refused:
            self.shutdown_request(request)
        else:
            super().process_request(request, client_address)

    def close_request(self, request: Any) -> None:
        """Close a connection, whatever came of it."""
        with self._lock:
            self._places.leave(request)
            super().close_request(request)

    def begin(self, request: socket.socket) -> bool:
        """The request is complete; False if its place went to another."""
        with self._lock:
            return self._places.answer(request)

    def end(self, request: socket.socket) -> None:
        """The answer is complete."""
        with self._lock:
            self._places.wait(request)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 - the base class's signature
        """A client that hangs up is not logged."""
        error = sys.exception()
        log.log(logging.DEBUG if isinstance(error, OSError) else logging.ERROR, "HTTP request failed", exc_info=error)


class HttpHandler(BaseHTTPRequestHandler):
    """One connection."""

    server: HttpServer

    def handle_one_request(self) -> None:
        """Answer one request, or hang up on an invalid one."""
        request = _read(self.request)
        self.rfile = BytesIO(request)
        if not request or not self.server.begin(self.request):
            self.close_connection = True
            return
        super().handle_one_request()
        self.server.end(self.request)

    def say(self, status: int, text: str) -> None:
        """A short answer for people and kubelets."""
        self.send_response(status)
        self.send_header("Content-Type", "text/plain; charset=utf-8")
        self.end_headers()
        self.wfile.write(text.encode())

    def version_string(self) -> str:
        """Not Python's version."""
        return "contextpolicy"

    def log_message(self, *_: object) -> None:
        """Log nothing: there is a probe or a scrape every few seconds."""


def _read(connection: socket.socket) -> bytes:
    """A request; empty if it is too long or too late."""
    request, deadline = b"", time.monotonic() + PATIENCE
    try:
        while END not in request:
            connection.settimeout(max(0.001, deadline - time.monotonic()))
            received = connection.recv(LONGEST - len(request))
            if not received or time.monotonic() > deadline:  # receives nothing where nothing more fits
                return b""
            request += received
        connection.settimeout(PATIENCE)
    except OSError:
        return b""
    return request
