"""The agent's answers over HTTP: /healthz for the kubelet, /metrics for Prometheus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.bus.http_server import HttpServer
from contextpolicy.bus.listening import EVERYWHERE
from contextpolicy.bus.metrics_page import MetricsPage

if TYPE_CHECKING:
    from collections.abc import Callable


def serve(port: int, alive: Callable[[], bool]) -> int:
    """Serve on threads of its own until the process ends; `alive` decides what /healthz says. Returns the port."""

    class Page(MetricsPage):
        def do_GET(self) -> None:
            """200 while the agent is alive, else 503; metrics on every other page."""
            if self.path != "/healthz":
                super().do_GET()
            elif alive():
                self.say(200, "ok\n")
            else:
                self.say(503, "the event loop does not respond\n")

    server = HttpServer((EVERYWHERE, port), Page, "service")
    server.start()
    return server.server_port
