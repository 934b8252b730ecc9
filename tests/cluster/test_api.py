"""What goes over the wire, and what its answers become; a real HTTP server on the loopback."""

from __future__ import annotations

import json
import re
import socket
from contextlib import ExitStack
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock, call

import pytest
from kubernetes import client
from kubernetes.config import ConfigException

from contextpolicy.cluster import api_connection
from contextpolicy.cluster.api import ApiServer
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from email.message import Message

POLICIES = "/apis/contextpolicy.dev/v1alpha1"
POD = {"kind": "Pod", "metadata": {"name": "slam", "generation": 3, "resourceVersion": "4711"}}


class Server(ThreadingHTTPServer):
    """Answers everything with `answer`; None means that it hangs up."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.requests: list[tuple[str, str, Message, Any]] = []
        self.answer: tuple[int, bytes] | None = (200, json.dumps(POD).encode())
        self.headers: dict[str, str] = {}


class Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"

    def _answer(self):
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.server.requests.append((self.command, self.path, self.headers, json.loads(body) if body else None))
        if self.server.answer is None:
            self.connection.shutdown(socket.SHUT_RDWR)
            self.close_connection = True
            return
        status, content = self.server.answer
        self.send_response(status)
        for name, value in {"Content-Length": str(len(content)), **self.server.headers}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    do_GET = do_PATCH = do_POST = _answer  # noqa: N815 - http.server looks for these names

    def log_message(self, *_):
        """Silent."""


@pytest.fixture
def server():
    with Server() as running:
        Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        yield running
        running.shutdown()


@pytest.fixture
def answers():
    """What hears of the answers."""
    return Mock()


@pytest.fixture
def open_api(server, monkeypatch, answers):
    """Open a client of the server, below a path of it."""
    with ExitStack() as stack:

        def open_api(path=""):
            settings = client.Configuration(host=f"http://127.0.0.1:{server.server_port}{path}")
            monkeypatch.setattr(api_connection, "_configure", lambda _: client.Configuration.set_default(settings))
            opened = ApiServer(answers)
            stack.callback(opened.close)
            return opened

        yield open_api
    client.Configuration.set_default(None)


@pytest.fixture
def api(open_api):
    return open_api()


def test_answers_and_missing_answers_are_reported(api, server, answers):
    api.pod("lab", "slam")
    server.answer = None
    with pytest.raises(ActuationError):
        api.pod("lab", "slam")
    assert answers.mock_calls == [call.on_answer("GET", "200"), call.on_answer("GET", "none")]


def refusal(api):
    with pytest.raises(ActuationError) as caught:
        api.resize("lab", "slam", {"spec": {}}, "contextpolicy")
    return caught.value


def test_a_resize_is_a_strategic_merge_of_the_subresource(api, server):
    patch = {"spec": {"containers": [{"name": "slam", "resources": {"limits": {"cpu": "300m"}}}]}}
    assert api.resize("lab", "slam", patch, "contextpolicy-restore") == 4711
    [(method, path, headers, body)] = server.requests
    assert (method, path) == ("PATCH", "/api/v1/namespaces/lab/pods/slam/resize?fieldManager=contextpolicy-restore")
    assert headers["Content-Type"] == "application/strategic-merge-patch+json"
    assert body == patch


@pytest.mark.parametrize("path", ["/k8s/clusters/c-1", "/k8s/clusters/c-1/"])
def test_a_cluster_may_be_served_below_a_path(open_api, server, path):
    open_api(path).post_event("lab", {})
    [(_, asked, _, _)] = server.requests
    assert asked.startswith("/k8s/clusters/c-1/api/v1/namespaces/lab/events?")


@pytest.mark.parametrize(("held", "read"), [({"data": {"a.msg": "bool b"}}, {"a.msg": "bool b"}), ({}, {})])
def test_a_config_map_is_read_by_its_name(api, server, held, read):
    server.answer = (200, json.dumps({"kind": "ConfigMap", **held}).encode())
    assert api.config_map("lab", "robot-types") == read
    assert [request[:2] for request in server.requests] == [("GET", "/api/v1/namespaces/lab/configmaps/robot-types")]


def test_originals_are_merged_into_the_status(api, server):
    assert api.write_originals("lab", "robot", {"uid-1": None}) == 4711
    [(method, path, headers, body)] = server.requests
    assert (method, path.partition("?")[0].rpartition("/")[2]) == ("PATCH", "status")
    assert headers["Content-Type"] == "application/merge-patch+json"
    assert body == {"status": {"originals": {"uid-1": None}}}


@pytest.mark.parametrize(
    ("kind", "namespace", "path"),
    [
        ("pods", None, "/api/v1/pods"),
        ("pods", "lab", "/api/v1/namespaces/lab/pods"),
        ("policies", "lab", f"{POLICIES}/namespaces/lab/contextpolicies"),
    ],
)
def test_objects_of_all_namespaces_or_of_one_are_listed(api, server, kind, namespace, path):
    server.answer = 200, b'{"items": [{"kind": "Any"}]}'
    assert list(getattr(api, kind)(namespace)) == [{"kind": "Any"}]
    assert [asked.partition("?")[0] for _, asked, _, _ in server.requests] == [path]


def test_an_object_deeper_than_python_decodes_keeps_no_other_from_being_read(api, server):
    server.answer = 200, b'{"items": [{"example": %s}, {"kind": "Any"}]}' % (b"[" * 10_000 + b"]" * 10_000)
    assert list(api.policies(None))[1] == {"kind": "Any"}


@pytest.mark.parametrize("answer", [b"<html>\n</html>", b"[]", b"{}", b'{"items'])
def test_malformed_list_is_an_error(api, server, answer):
    """A proxy answers, or a server of another kind."""
    server.answer = 200, answer
    with pytest.raises(ActuationError, match=r"expected the JSON object that was requested: .+$") as caught:
        list(api.policies(None))
    assert (caught.value.reason, caught.value.retriable) == ("Unreadable", True)


@pytest.mark.parametrize("kind", ["pods", "policies"])
def test_a_closed_namespace_is_an_error(api, server, kind):
    server.answer = 403, b'{"message": "you may not"}'
    with pytest.raises(ActuationError, match="you may not") as caught:
        list(getattr(api, kind)("closed"))
    assert caught.value.reason == "Forbidden"


def test_page_is_read_no_further_than_it_may_be(api, server):
    server.answer = 200, json.dumps({"items": ["x" * 1000]}).encode()
    assert api.read_page("/api/v1/pods?limit=2", 1000) is None
    page = api.read_page("/api/v1/pods?limit=1", None)
    assert (page.content, page.weight) == ({"items": ["x" * 1000]}, len(server.answer[1]))


def test_page_that_ends_early_is_an_error(api, server):
    server.headers = {"Content-Length": "1000", "Connection": "close"}
    server.answer = 200, b'{"items": ['
    with pytest.raises(ActuationError) as caught:
        api.read_page("/api/v1/pods?limit=2", 1000)
    assert (caught.value.reason, caught.value.retriable) == ("Unreachable", True)


def test_finalizers_are_replaced_in_the_version_that_was_read(api, server):
    api.set_finalizers("lab", "robot", ["example.com/backup"], "7")
    [(method, path, _, body)] = server.requests
    assert (method, path.partition("?")[0]) == ("PATCH", f"{POLICIES}/namespaces/lab/contextpolicies/robot")
    assert body == {"metadata": {"finalizers": ["example.com/backup"], "resourceVersion": "7"}}


def test_one_pod_is_read(api, server):
    assert api.pod("lab", "slam")["metadata"]["resourceVersion"] == "4711"
    [(method, path, _, _)] = server.requests
    assert (method, path) == ("GET", "/api/v1/namespaces/lab/pods/slam")


def test_a_token_that_cannot_be_renewed_is_a_failure_like_others(api, monkeypatch):
    def fail(*_):
        raise ConfigException("exec plugin is gone")

    monkeypatch.setattr(api._connection._client, "update_params_for_auth", fail)
    with pytest.raises(ActuationError, match="exec plugin is gone") as caught:
        api.resize("lab", "slam", {}, "contextpolicy")
    assert (caught.value.reason, caught.value.retriable) == ("NoToken", True)


def test_a_status_is_merged_into_the_subresource(api, server):
    api.write_status("lab", "robot", {"plan": None, "contexts": "-"})
    [(method, path, _, body)] = server.requests
    assert (method, path.partition("?")[0]) == (
        "PATCH",
        "/apis/contextpolicy.dev/v1alpha1/namespaces/lab/contextpolicies/robot/status",
    )
    assert body == {"status": {"plan": None, "contexts": "-"}}


def test_an_event_is_posted(api, server):
    api.post_event("lab", {"reason": "Invalid"})
    assert [(m, p.partition("?")[0], b) for m, p, _, b in server.requests] == [
        ("POST", "/api/v1/namespaces/lab/events", {"reason": "Invalid"})
    ]


@pytest.mark.parametrize(
    ("status", "reason", "retriable"),
    [
        *((400, "BadRequest", False), (401, "Unauthorized", True), (403, "Forbidden", False), (404, "NotFound", False)),
        *((409, "Conflict", True), (422, "Invalid", False), (429, "TooManyRequests", True), (418, "Refused", False)),
        *((500, "ServerError", True), (503, "ServerError", True), (504, "ServerError", True)),
    ],
)
def test_http_errors_map_to_reason_and_retriable(api, server, status, reason, retriable):
    server.answer = status, json.dumps({"kind": "Status", "message": "because"}).encode()
    error = refusal(api)
    assert (error.reason, error.retriable, str(error)) == (reason, retriable, f"because (HTTP {status})")


@pytest.mark.parametrize(
    ("header", "seconds"),
    [({}, 0), ({"Retry-After": "3"}, 3), ({"Retry-After": "Wed, 21 Oct 2026 07:28:00 GMT"}, 0)],
)
def test_retry_after_header_is_read(api, server, header, seconds):
    server.answer, server.headers = (429, b"Too many requests, please try again later.\n"), header
    error = refusal(api)
    assert (error.reason, error.retriable, error.retry_after) == ("TooManyRequests", True, seconds)


@pytest.mark.parametrize("content", [b"", b"<html>gateway</html>", b"[]", b"\xff\xfe", b'"text"'])
def test_malformed_error_body_is_a_server_error(api, server, content):
    server.answer = 502, content
    assert refusal(api).reason == "ServerError"


@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b"null", b'{"metadata": null}', b"<html>", b"\xff\xfe"])
def test_an_answer_without_a_pod_is_retried(api, server, content):
    server.answer = 200, content
    error = refusal(api)
    assert (error.reason, error.retriable) == ("Unreadable", True)


def test_a_server_that_hangs_up_is_unreachable(api, server):
    server.answer = None
    error = refusal(api)
    assert (error.reason, error.retriable) == ("Unreachable", True)
    assert re.search(r"API server at http://127.0.0.1:\d+ to PATCH .*/resize: Remote end closed connection", str(error))
    assert len(server.requests) == 1, "the resizer decides when to try again, not the connection pool"


@pytest.mark.parametrize(
    ("host", "reason"),
    [("http://127.0.0.1:1", "Connection refused"), ("http://nobody.invalid:1", "")],
)
def test_unreachable_server_error_hides_library_objects(monkeypatch, host, reason):
    settings = client.Configuration(host=host)
    monkeypatch.setattr(api_connection, "_configure", lambda _: client.Configuration.set_default(settings))
    api = ApiServer(Mock())
    with pytest.raises(
        ActuationError, match=f"^no answer from the API server at {host} to GET /version: .*{reason}$"
    ) as caught:
        api.read("/version")
    client.Configuration.set_default(None)
    assert "object at" not in str(caught.value)
    assert "Pool" not in str(caught.value)


@pytest.mark.parametrize(("answer", "serves"), [((200, b"{}"), True), ((404, b"{}"), False)])
def test_installed_crd_is_detected(api, server, answer, serves):
    server.answer = answer
    assert api.serves_policies() is serves


def test_unavailable_server_does_not_mean_a_missing_crd(api, server):
    server.answer = 503, b"{}"
    with pytest.raises(ActuationError):
        api.serves_policies()
