"""Lists and finalizers over HTTP: what is asked of an API server, and what its answers mean."""

from __future__ import annotations

import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.cluster.api import ApiServer
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

POLICIES = "/apis/contextpolicy.dev/v1alpha1"
ANSWERS = {
    "/api/v1/pods": (200, {"items": [{"kind": "Pod"}]}),
    "/api/v1/namespaces/lab/pods": (200, {"items": []}),
    "/api/v1/namespaces/closed/pods": (403, {"message": "you may not"}),
    f"{POLICIES}/namespaces/lab/contextpolicies": (200, {"items": [{"kind": "ContextPolicy"}]}),
    f"{POLICIES}/namespaces/closed/contextpolicies": (403, {"message": "you may not"}),
    f"{POLICIES}/namespaces/lab/contextpolicies/robot": (200, {}),
}


class Handler(BaseHTTPRequestHandler):
    """Answers from the table; anything else is not found."""

    seen: list[tuple[str, str, Any]]

    def answer(self) -> None:
        path = self.path.partition("?")[0]
        length = int(self.headers.get("Content-Length") or 0)
        self.seen.append((self.command, path, json.loads(self.rfile.read(length) or "null")))
        status, body = ANSWERS.get(path, (404, {"message": "page not found"}))
        self.send_response(status)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    do_GET = do_PATCH = answer  # noqa: N815 - the names that http.server calls

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def serving() -> Iterator[tuple[ThreadingHTTPServer, list[tuple[str, str, Any]]]]:
    seen: list[tuple[str, str, Any]] = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Seen", (Handler,), {"seen": seen}))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server, seen
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def api(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ApiServer, list[tuple[str, str, Any]]]]:
    """The client, and the requests that arrive."""
    with serving() as (server, seen):
        config = {
            "current-context": "lab",
            "contexts": [{"name": "lab", "context": {"cluster": "lab", "user": "me"}}],
            "clusters": [{"name": "lab", "cluster": {"server": f"http://127.0.0.1:{server.server_port}"}}],
            "users": [{"name": "me", "user": {}}],
        }
        (tmp_path / "config").write_text(json.dumps(config), encoding="utf-8")
        location = "kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION"
        monkeypatch.setattr(location, str(tmp_path / "config"))
        monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)
        client = ApiServer()
        yield client, seen
        client.close()


def test_pods_of_all_namespaces_or_of_one(api):
    client, _ = api
    assert client.pods(None) == [{"kind": "Pod"}]
    assert client.pods("lab") == []


def test_policies(api):
    client, _ = api
    assert client.policies("lab") == [{"kind": "ContextPolicy"}]


def test_where_the_definition_is_missing_there_are_no_policies(api):
    client, _ = api
    assert client.policies(None) == []


@pytest.mark.parametrize("kind", ["pods", "policies"])
def test_a_closed_namespace_is_an_error(api, kind):
    client, _ = api
    with pytest.raises(ActuationError, match="you may not") as caught:
        getattr(client, kind)("closed")
    assert caught.value.reason == "Forbidden"


def test_finalizers_are_replaced_in_the_version_that_was_read(api):
    client, seen = api
    client.set_finalizers("lab", "robot", ["example.com/backup"], "7")
    patch = {"metadata": {"finalizers": ["example.com/backup"], "resourceVersion": "7"}}
    assert seen == [("PATCH", f"{POLICIES}/namespaces/lab/contextpolicies/robot", patch)]
