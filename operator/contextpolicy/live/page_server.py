"""The live page and its data over HTTP, on the loopback only."""

from __future__ import annotations

import json
import logging
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
"""Names under which a browser may ask. A page of somebody else could let its own name point to this loopback and read
what is here with the viewer's browser (DNS rebinding): then the name in the request is that page's."""
AT_ONCE = 4
"""Requests answered at the same time: people who watch must not slow down what they watch."""
ASSETS = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Watched(Protocol):
    """What there is to see; called on the server's threads. TimeoutError when the operator does not answer."""

    def boards(self) -> list[dict[str, Any]]:
        """All policies (see `live.board`)."""

    def plans(self, policy: str, since: float) -> list[dict[str, Any]]:
        """The policy's recorded plans after `since` (Unix seconds), oldest first."""

    def explanation(self, policy: str) -> dict[str, Any] | None:
        """Why each task has its share (see `explain.explanation`); None when there is no such policy."""

    def recording(self, policy: str, last: float) -> dict[str, Any] | None:
        """The last seconds of the policy (see `recorder.recording`); None when there is no such policy."""


class PageServer(ThreadingHTTPServer):
    """Answers GET, until closed; binds the loopback."""

    daemon_threads = True

    def __init__(self, port: int, watched: Watched) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.watched = watched
        self.places = threading.BoundedSemaphore(AT_ONCE)

    def start(self) -> None:
        """Serve on a thread of its own."""
        threading.Thread(target=self.serve_forever, name="live", daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 - the base class's signature
        """A browser that hangs up is nothing to log."""
        log.debug("live page: a request failed: %r", sys.exception())


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"
    timeout = 10

    def do_GET(self) -> None:
        """Answer one question."""
        if _host(self.headers.get("Host", "")) not in HOSTS:
            self._send(HTTPStatus.FORBIDDEN, "text/plain", b"reached by a name that is not this machine's\n")
            return
        if not self.server.places.acquire(blocking=False):
            self._send(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"too many watch at once\n")
            return
        try:
            self._answer()
        finally:
            self.server.places.release()

    def _answer(self) -> None:
        url = urlsplit(self.path)
        if url.path in ASSETS:
            name, kind = ASSETS[url.path]
            self._send(HTTPStatus.OK, kind, files("contextpolicy.live").joinpath(name).read_bytes())
            return
        question = _QUESTIONS.get(url.path)
        if question is None:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here\n")
            return
        try:
            answer = question(self.server.watched, {name: values[-1] for name, values in parse_qs(url.query).items()})
        except ValueError as error:
            self._send(HTTPStatus.BAD_REQUEST, "text/plain", f"{error}\n".encode())
        except TimeoutError:
            self._send(HTTPStatus.GATEWAY_TIMEOUT, "text/plain", b"the operator does not answer\n")
        else:
            status = HTTPStatus.NOT_FOUND if answer is None else HTTPStatus.OK
            self._send(status, "application/json", json.dumps(answer).encode())

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def version_string(self) -> str:
        """Not Python's version."""
        return "contextpolicy"

    def log_message(self, *_: object) -> None:
        """A page asks twice a second."""


def _host(header: str) -> str:
    try:
        return urlsplit(f"//{header}").hostname or ""
    except ValueError:
        return ""


def _number(asked: dict[str, str], name: str, default: float) -> float:
    try:
        return float(asked.get(name, default))
    except ValueError:
        raise ValueError(f"{name} {asked[name]} is not allowed: a number of seconds") from None


def _policy(asked: dict[str, str]) -> str:
    policy = asked.get("policy", "")
    if policy.count("/") != 1:
        raise ValueError(f"policy {policy!r} is not allowed: NAMESPACE/NAME")
    return policy


_QUESTIONS: dict[str, Callable[[Watched, dict[str, str]], Any]] = {
    "/api/boards": lambda watched, _: watched.boards(),
    "/api/plans": lambda watched, asked: watched.plans(_policy(asked), _number(asked, "since", 0.0)),
    "/api/explanation": lambda watched, asked: watched.explanation(_policy(asked)),
    "/api/recording": lambda watched, asked: watched.recording(_policy(asked), _number(asked, "last", 1e9)),
}
