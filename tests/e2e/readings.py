"""The resource metrics API with readings that a test makes up: what a metrics-server says, without one."""

from __future__ import annotations

import json
import ssl
import threading
from contextlib import contextmanager
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

from tests.bus.certificates import Authority
from tests.e2e.cluster import run
from tests.node.layout import NODE_ADDRESS
from tests.node.metrics_api import GROUP, ROOT, register, withdraw

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class Readings:
    """Every pod of a label `app` uses `millicores`; `asked` counts the autoscaler's questions."""

    def __init__(self, millicores: int) -> None:
        self.millicores, self.asked = millicores, 0

    def answer(self, path: str) -> dict[str, Any]:
        """The list of kinds, or of a namespace's pods."""
        if not path.startswith(f"{ROOT}/namespaces/"):
            kinds = [{"name": "pods", "namespaced": True, "kind": "PodMetrics", "verbs": ["get", "list"]}]
            return {
                "kind": "APIResourceList",
                "apiVersion": "v1",
                "groupVersion": f"{GROUP}/v1beta1",
                "resources": kinds,
            }
        self.asked += 1
        found = json.loads(run("kubectl", "get", "pods", "-n", path.split("/")[5], "-l", "app", "-o", "json"))
        items = [self._pod(pod) for pod in found["items"]]
        return {"kind": "PodMetricsList", "apiVersion": f"{GROUP}/v1beta1", "metadata": {}, "items": items}

    def _pod(self, pod: dict[str, Any]) -> dict[str, Any]:
        usage = {"cpu": f"{self.millicores}m", "memory": "10Mi"}
        names = [container["name"] for container in pod["spec"]["containers"]]
        metadata = {name: pod["metadata"][name] for name in ("name", "namespace", "labels")}
        moment = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        containers = [{"name": name, "usage": usage} for name in names]
        return {"metadata": metadata, "timestamp": moment, "window": "1s", "containers": containers}


@contextmanager
def metrics_api(directory: Path, readings: Readings) -> Iterator[None]:
    """While this holds the cluster has resource metrics."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            content = json.dumps(readings.answer(self.path.partition("?")[0])).encode()
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer((NODE_ADDRESS, 0), Handler)
    issued = Authority(directory).issue("metrics")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(issued / "tls.crt", issued / "tls.key")
    server.socket = context.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        register(server.server_port)
        yield
    finally:
        withdraw()
        server.shutdown()
        server.server_close()
