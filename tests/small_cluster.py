"""An API server that serves just enough for the operator's process, and an operator that only records its calls."""

from __future__ import annotations

import json
import threading
from concurrent.futures import Future
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from unittest.mock import create_autospec

from contextpolicy.app.wiring import Operator
from tests.cluster.builders import a_pod
from tests.waiting import PATIENCE

METHODS = (
    "connected",
    "policy_changed",
    "policy_deleted",
    "policy_seen",
    "policy_gone",
    "pod_changed",
    "pod_gone",
    "node_changed",
    "node_gone",
    "abandon",
    "resume",
    "close",
)


class Recorder:
    """`operator` takes what the real one takes, and does nothing; `restored` is done when the test says so.

    `calls` are in order, objects by their names.
    """

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.restored: Future[Any] = Future()
        self.readable = True
        self._news = threading.Condition()
        self.operator = create_autospec(Operator, instance=True, spec_set=True)
        for name in METHODS:
            getattr(self.operator, name).side_effect = partial(self._note, name)

    def wait_for(self, *call: object) -> None:
        with self._news:
            assert self._news.wait_for(lambda: call in self.calls, PATIENCE), self.calls

    def _note(self, name: str, *arguments: Any) -> Future[Any]:
        subjects = (one["metadata"]["name"] if isinstance(one, dict) else one for one in arguments)
        with self._news:
            self.calls.append((name, *subjects))
            self._news.notify_all()
        done: Future[Any] = Future()
        done.set_result(self.readable)
        return self.restored if name == "policy_deleted" else done


def a_deleted_policy() -> dict[str, Any]:
    return {
        "metadata": {
            "name": "robot",
            "namespace": "lab",
            "uid": "uid-robot",
            "resourceVersion": "5",
            "generation": 1,
            "deletionTimestamp": "2026-01-01T00:00:00Z",
            "finalizers": ["contextpolicy.dev/restore"],
        },
        "spec": {},
    }


class SmallCluster(ThreadingHTTPServer):
    """Serves one policy that is being deleted, and Leases; what is in `gates` is only listed when its event is set."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.pods_allowed, self.nodes_allowed, self.ended = threading.Event(), threading.Event(), threading.Event()
        self.policies_listed = threading.Event()
        self.installed = True
        self.closed: set[str] = set()
        """Namespaces whose pods may not be listed."""
        self.by_kopf: list[str] = []
        self.written: list[tuple[str, str]] = []
        node = {"metadata": {"name": "robot-1", "uid": "uid-node", "resourceVersion": "4"}}
        self.lists = {"contextpolicies": [a_deleted_policy()], "pods": [a_pod("slam")], "nodes": [node]}
        self.leases: dict[str, dict[str, Any]] = {}
        self.lease_news = threading.Condition()
        self._versions = 100

    @property
    def kubeconfig(self) -> dict[str, Any]:
        return {
            "apiVersion": "v1",
            "kind": "Config",
            "current-context": "test",
            "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test"}}],
            "clusters": [{"name": "test", "cluster": {"server": f"http://127.0.0.1:{self.server_port}"}}],
            "users": [{"name": "test", "user": {}}],
        }

    def put_lease(self, namespace: str, name: str, **spec: Any) -> dict[str, Any]:
        """Whatever was there before."""
        with self.lease_news:
            self._versions += 1
            metadata = {"name": name, "namespace": namespace, "uid": name, "resourceVersion": str(self._versions)}
            lease = self.leases[f"{namespace}/{name}"] = {"metadata": metadata, "spec": spec}
            self.lease_news.notify_all()
            return lease

    def holder(self, namespace: str, name: str) -> str | None:
        lease = self.leases.get(f"{namespace}/{name}")
        return lease["spec"].get("holderIdentity") if lease else None

    def handle_error(self, *_: object) -> None:
        """Kopf ends its watches by hanging up."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: SmallCluster

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        plural = path.rpartition("/")[2]
        if plural in ("pods", "nodes") and "kopf" in self.headers["User-Agent"]:
            self.server.by_kopf.append(path)
        if "watch=true" in query:
            self._hold(self._selected(path, query) if plural == "leases" else None)
        elif plural == "leases":
            found = self.server.leases.get(self._selected(path, query))
            self._answer({"metadata": {"resourceVersion": "9"}, "items": [found] if found else []})
        elif "/leases/" in path:
            lease = self.server.leases.get(self._lease_key(path))
            self._answer(lease or {"message": "no such Lease"}, 200 if lease else 404)
        elif plural in self.server.lists:
            if plural == "pods" and path.split("/")[-2] in self.server.closed:
                self._answer({"message": "no role"}, 403)
            else:
                self._list(plural)
        else:
            there = path != "/apis/contextpolicy.dev/v1alpha1" or self.server.installed
            self._answer(DISCOVERY.get(path, {}) if there else {"message": "not found"}, 200 if there else 404)

    def do_PATCH(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.server.written.append(("PATCH", self.path.partition("?")[0]))
        self._answer(self.server.lists["contextpolicies"][0])

    def do_POST(self) -> None:
        self._write_lease()

    def do_PUT(self) -> None:
        self._write_lease()

    def log_message(self, *_: object) -> None:
        """Silent."""

    def _write_lease(self) -> None:
        wanted = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        metadata = wanted["metadata"]
        there = self.server.leases.get(f"{metadata['namespace']}/{metadata['name']}")
        version = there["metadata"]["resourceVersion"] if there else None
        if metadata.get("resourceVersion") != version:
            self._answer({"message": "changed"}, 409)
        else:
            self._answer(self.server.put_lease(metadata["namespace"], metadata["name"], **wanted["spec"]))

    def _selected(self, path: str, query: str) -> str:
        """The one Lease that a list or watch is about."""
        return f"{path.split('/')[-2]}/{query.partition('metadata.name=')[2].partition('&')[0]}"

    def _lease_key(self, path: str) -> str:
        parts = path.split("/")
        return f"{parts[-3]}/{parts[-1]}"

    def _list(self, plural: str) -> None:
        gate = {"pods": self.server.pods_allowed, "nodes": self.server.nodes_allowed}.get(plural)
        if gate is not None:
            gate.wait(PATIENCE)
        self._answer({"metadata": {"resourceVersion": "9"}, "items": self.server.lists[plural]})
        if plural == "contextpolicies" and "kopf" in self.headers["User-Agent"]:
            self.server.policies_listed.set()

    def _hold(self, lease: str | None) -> None:
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()
        reported: dict[str, Any] | None = None
        while lease is not None and not self.server.ended.is_set():
            with self.server.lease_news:
                there = self.server.leases.get(lease)
                if there is not reported:
                    self._chunk({"type": "MODIFIED", "object": there})
                    reported = there
                self.server.lease_news.wait(0.2)
        self.server.ended.wait(PATIENCE)
        self.wfile.write(b"0\r\n\r\n")

    def _chunk(self, event: dict[str, Any]) -> None:
        line = json.dumps(event).encode() + b"\n"
        self.wfile.write(f"{len(line):x}\r\n".encode() + line + b"\r\n")
        self.wfile.flush()

    def _answer(self, content: dict[str, Any], status: int = 200) -> None:
        body = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _group(name: str, version: str) -> dict[str, Any]:
    served = {"groupVersion": f"{name}/{version}", "version": version}
    return {"name": name, "versions": [served], "preferredVersion": served}


def _resource(plural: str, kind: str, *, namespaced: bool = True) -> dict[str, Any]:
    verbs = ["list", "watch", "patch", "get"]
    return {"name": plural, "singularName": "", "kind": kind, "namespaced": namespaced, "verbs": verbs}


CRDS = _resource("customresourcedefinitions", "CustomResourceDefinition", namespaced=False)
CORE = [
    _resource("pods", "Pod"),
    _resource("nodes", "Node", namespaced=False),
    _resource("namespaces", "Namespace", namespaced=False),
    _resource("events", "Event"),
]
DISCOVERY: dict[str, dict[str, Any]] = {
    "/api": {"versions": ["v1"]},
    "/apis": {"groups": [_group("contextpolicy.dev", "v1alpha1"), _group("apiextensions.k8s.io", "v1")]},
    "/api/v1": {"resources": CORE},
    "/apis/apiextensions.k8s.io/v1": {"resources": [CRDS]},
    "/apis/contextpolicy.dev/v1alpha1": {"resources": [_resource("contextpolicies", "ContextPolicy")]},
}
