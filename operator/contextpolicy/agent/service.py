"""The agent's answers over HTTP: /healthz for the kubelet, /metrics for Prometheus."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING
from wsgiref.simple_server import WSGIRequestHandler, make_server

from prometheus_client import Counter, Gauge, Histogram, make_wsgi_app

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from wsgiref.types import StartResponse, WSGIEnvironment

REFUSALS = Counter("contextpolicy_agent_refusals_total", "What the agent would not or could not do.", ["reason"])
WRITES = Counter("contextpolicy_agent_writes_total", "Writes of cgroup files by result.", ["result"])
CONNECTED = Gauge("contextpolicy_agent_bus_connected", "1 while the agent has a session with a router.")
OBEYED_SECONDS = Histogram(
    "contextpolicy_agent_plan_seconds",
    "Time from a plan's signing until its limits are written, by the node's clock.",
    buckets=(0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5),
)


def serve(port: int, alive: Callable[[], bool]) -> int:
    """Serve on a thread of its own until the process ends; `alive` decides what /healthz says. Returns the port."""
    metrics = make_wsgi_app()

    def answer(environment: WSGIEnvironment, start_response: StartResponse) -> Iterable[bytes]:
        if environment["PATH_INFO"] != "/healthz":
            page: Iterable[bytes] = metrics(environment, start_response)
            return page
        healthy = alive()
        start_response("200 OK" if healthy else "503 Service Unavailable", [("Content-Type", "text/plain")])
        return [b"ok\n" if healthy else b"the loop does not answer\n"]

    server = make_server("", port, answer, handler_class=_Quiet)
    threading.Thread(target=server.serve_forever, name="service", daemon=True).start()
    return server.server_port


class _Quiet(WSGIRequestHandler):
    def log_message(self, *_: object) -> None:
        """Log nothing: there is a probe every few seconds."""
