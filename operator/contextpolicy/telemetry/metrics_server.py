"""The operator's and the router's /metrics."""

from __future__ import annotations

from contextpolicy.bus.http_server import HttpServer
from contextpolicy.bus.listening import EVERYWHERE
from contextpolicy.bus.metrics_page import MetricsPage


def serve_metrics(port: int) -> int:
    """Serve what is registered, on threads of its own until the process ends; returns the port."""
    server = HttpServer((EVERYWHERE, port), MetricsPage, "metrics")
    server.start()
    return server.server_port
