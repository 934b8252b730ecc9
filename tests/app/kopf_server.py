"""As much of an API server as kopf needs to serve policies: discovery, lists, silent watches and patches."""

from __future__ import annotations

import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event
from typing import Any

from contextpolicy.policy.custom_resource import FINALIZER, GROUP, PLURAL

VERSION = "v1alpha1"
ROOT = f"/apis/{GROUP}/{VERSION}"
_POLICY = {"kind": "ContextPolicy", "namespaced": True}
_GROUP = {"name": GROUP, "preferredVersion": {"groupVersion": f"{GROUP}/{VERSION}", "version": VERSION}}
_SPACES = {"name": "namespaces", "singularName": "namespace", "kind": "Namespace", "verbs": ["list"]}
ANSWERS: dict[str, Any] = {
    "/api": {"versions": ["v1"]},
    "/api/v1": {"resources": [{**_SPACES, "namespaced": False}]},
    "/apis": {"groups": [{**_GROUP, "versions": [_GROUP["preferredVersion"]]}]},
    ROOT: {
        "resources": [
            {**_POLICY, "name": PLURAL, "singularName": "contextpolicy", "verbs": ["list", "watch", "patch"]},
            {**_POLICY, "name": f"{PLURAL}/status", "singularName": "", "verbs": ["patch"]},
        ]
    },
}


def a_policy_in(namespace: str) -> dict[str, Any]:
    """It has the finalizer already, so that kopf goes on to its handlers."""
    metadata: dict[str, Any] = {
        "name": "robot",
        "namespace": namespace,
        "uid": f"uid-{namespace}",
        "resourceVersion": "5",
    }
    metadata |= {"creationTimestamp": "2026-01-01T00:00:00Z", "finalizers": [FINALIZER]}
    return {"apiVersion": f"{GROUP}/{VERSION}", "kind": "ContextPolicy", "metadata": metadata, "spec": {}}


class KopfServer(ThreadingHTTPServer):
    """`lists` are the texts of the policies of each namespace."""

    daemon_threads = True

    def __init__(self, lists: dict[str, str]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.lists, self.ended = lists, Event()


class _Handler(BaseHTTPRequestHandler):
    server: KopfServer

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        if "watch=true" in query:
            self._say(b"")
            self.server.ended.wait()
        elif path in ANSWERS:
            self._say(json.dumps(ANSWERS[path]).encode())
        else:
            policies = self.server.lists[path.split("/")[-2]]
            self._say(f'{{"metadata": {{"resourceVersion": "9"}}, "items": [{policies}]}}'.encode())

    def do_PATCH(self) -> None:
        self._say(json.dumps(a_policy_in(self.path.split("/")[-3])).encode())

    def _say(self, answer: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, *_: object) -> None:
        """Silent."""
