"""The live page and its data over HTTP, on the loopback only."""

from __future__ import annotations

import gzip
import json
import logging
import math
import socket
import threading
from functools import cache
from http import HTTPStatus
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import parse_qs, urlsplit

from contextpolicy.bus.http_server import HttpHandler, HttpServer
from contextpolicy.bus.listening import loopback

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

log = logging.getLogger(__name__)

HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
"""Names under which a browser may ask. A foreign page could resolve its own name to this loopback and read
what is here with the viewer's browser (DNS rebinding): then the name in the request is that page's."""
AT_ONCE = 4
"""Questions to the operator answered at the same time: people who watch must not slow down what they watch."""
QUEUE = 1.0
"""Seconds that one more waits for a place: a page that is sent away shows what it has as old."""
ASSETS = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    **{f"/{name}.js": (f"{name}.js", "text/javascript; charset=utf-8") for name in ("page", "figures", "tables")},
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
    """The data to show; called on the server's threads. TimeoutError when the operator does not answer."""

    def boards(self) -> list[dict[str, Any]]:
        """All policies (see `live.board`)."""

    def plans(self, policy: str, since: float) -> list[dict[str, Any]]:
        """The policy's plans that were recorded or ended after `since` (Unix seconds), oldest first."""

    def explanation(self, policy: str) -> dict[str, Any] | None:
        """Why each task has its share (see `explain.explanation`); None when the policy does not exist."""

    def recording(self, policy: str, last: float) -> dict[str, Any] | None:
        """The last seconds of the policy (see `recorder.recording`); None when the policy does not exist."""


class PageServer(HttpServer):
    """Answers GET and HEAD, until closed; binds the loopback."""

    def __init__(self, port: int, watched: Watched) -> None:
        own = loopback()
        self.address_family = socket.AF_INET6 if ":" in own else socket.AF_INET
        super().__init__((own, port), _Handler, "live")
        self.watched = watched
        self.places = threading.BoundedSemaphore(AT_ONCE)


class _Handler(HttpHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"
    default_request_version = "HTTP/1.0"  # of what is no request: with 0.9 the answer would have no status

    def do_GET(self) -> None:
        """Answer one question."""
        if _host(self.headers.get("Host", "")) not in HOSTS:
            self._send(HTTPStatus.FORBIDDEN, "text/plain", b"the Host header names another machine\n")
            return
        try:
            url = urlsplit(self.path)
        except ValueError:
            self._send(HTTPStatus.BAD_REQUEST, "text/plain", b"expected a path of this server\n")
            return
        if url.path in ASSETS:
            name, kind = ASSETS[url.path]
            if "gzip" in self.headers.get("Accept-Encoding", ""):
                self._send(HTTPStatus.OK, kind, packed(name), {"Content-Encoding": "gzip"})
            else:
                self._send(HTTPStatus.OK, kind, _asset(name))
        elif url.path not in _QUESTIONS:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here\n")
        elif not self.server.places.acquire(timeout=QUEUE):
            self._send(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"too many viewers at once\n")
        else:
            try:
                self._answer(_QUESTIONS[url.path], url.query)
            finally:
                self.server.places.release()

    def do_HEAD(self) -> None:
        """The same without the body."""
        self.do_GET()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        """Refuse an invalid request with a line of text, like every other refusal, instead of Python's page."""
        unknown = code == HTTPStatus.NOT_IMPLEMENTED
        said = "expected GET or HEAD" if unknown else message or HTTPStatus(code).phrase
        self._send(HTTPStatus(code), "text/plain", f"{said}\n".encode(), {"Connection": "close"})

    def _answer(self, question: Callable[[Watched, dict[str, str]], Any], query: str) -> None:
        try:
            answer = question(self.server.watched, {name: values[-1] for name, values in parse_qs(query).items()})
        except ValueError as error:
            self._send(HTTPStatus.BAD_REQUEST, "text/plain", f"{error}\n".encode())
        except TimeoutError:
            self._send(HTTPStatus.GATEWAY_TIMEOUT, "text/plain", b"the operator does not answer\n")
        except Exception:
            log.exception("a query of the live page failed: %s", self.path)
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, "text/plain", b"the operator failed: its log says why\n")
        else:
            status = HTTPStatus.NOT_FOUND if answer is None else HTTPStatus.OK
            self._send(status, "application/json", json.dumps(answer).encode())

    def _send(self, status: HTTPStatus, kind: str, body: bytes, more: Mapping[str, str] = MappingProxyType({})) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **more, "Content-Type": kind, "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)


def _asset(name: str) -> bytes:
    return files("contextpolicy.live").joinpath(name).read_bytes()


@cache
def packed(name: str) -> bytes:
    """An asset as browsers get it: a third of its size, over a robot's radio."""
    return gzip.compress(_asset(name), mtime=0)


def _host(header: str) -> str:
    try:
        return urlsplit(f"//{header}").hostname or ""
    except ValueError:
        return ""


def _number(asked: dict[str, str], name: str, default: float) -> float:
    try:
        number = float(asked.get(name, default))
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise ValueError(f"{name}: invalid value {asked[name]!r}: expected a number of seconds, at least 0")
    return number


def _policy(asked: dict[str, str]) -> str:
    policy = asked.get("policy", "")
    if policy.count("/") != 1:
        raise ValueError(f"policy: invalid value {policy!r}: expected NAMESPACE/NAME")
    return policy


_QUESTIONS: dict[str, Callable[[Watched, dict[str, str]], Any]] = {
    "/api/boards": lambda watched, _: watched.boards(),
    "/api/plans": lambda watched, asked: watched.plans(_policy(asked), _number(asked, "since", 0.0)),
    "/api/explanation": lambda watched, asked: watched.explanation(_policy(asked)),
    "/api/recording": lambda watched, asked: watched.recording(_policy(asked), _number(asked, "last", 1e9)),
}
