"""/metrics over HTTP."""

from __future__ import annotations

from prometheus_client import MetricsHandler

from contextpolicy.bus.http_server import HttpHandler, HttpServer
from contextpolicy.bus.listening import EVERYWHERE


class _Metrics(HttpHandler, MetricsHandler):
    """What is registered."""


def serve_metrics(port: int) -> int:
    """Serve what is registered, on threads of its own until the process ends; returns the port."""
    server = HttpServer((EVERYWHERE, port), _Metrics, "metrics")
    server.start()
    return server.server_port
