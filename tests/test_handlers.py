"""What kopf is told, and the one promise of its that the rest relies on, against a small API server."""

from __future__ import annotations

import asyncio
import json
import threading
from concurrent.futures import Future
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from unittest.mock import create_autospec

import kopf
import kubernetes.config.kube_config
import pytest

from contextpolicy import handlers
from contextpolicy.runtime import Runtime
from contextpolicy.settings import Settings
from tests.cluster.builders import a_pod

PATIENCE = 20.0


METHODS = ("connected", "policy_changed", "policy_deleted", "pod_changed", "pod_gone", "node_changed", "delay", "close")


class Told:
    """`runtime` takes what the real one takes, and does nothing; `restored` is done when the test says so.

    `calls` are in order, objects by their names.
    """

    def __init__(self):
        self.calls, self.restored, self.readable = [], Future(), True
        self._news = threading.Condition()
        self.runtime = create_autospec(Runtime, instance=True, spec_set=True)
        for name in METHODS:
            getattr(self.runtime, name).side_effect = partial(self._note, name)

    def wait_for(self, *call):
        with self._news:
            assert self._news.wait_for(lambda: call in self.calls, PATIENCE), self.calls

    def _note(self, name, *arguments):
        subjects = (one["metadata"]["name"] if isinstance(one, dict) else one for one in arguments)
        with self._news:
            self.calls.append((name, *subjects))
            self._news.notify_all()
        done = Future()
        done.set_result(self.readable)
        return self.restored if name == "policy_deleted" else done


def run(coroutine):
    return asyncio.run(coroutine)


def memo(told):
    return SimpleNamespace(runtime=told.runtime)


@pytest.fixture
def told():
    return Told()


def test_a_policy_is_handed_over_as_a_plain_object(told):
    run(handlers.apply(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(told)))
    assert told.calls == [("policy_changed", "robot")]
    assert type(told.runtime.policy_changed.call_args.args[0]) is dict


def test_a_policy_that_names_what_is_not_there_yet_comes_again(told):
    told.readable = False
    with pytest.raises(kopf.TemporaryError) as caught:
        run(handlers.apply(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(told)))
    assert caught.value.delay == handlers.REREAD


def test_a_policy_goes_when_all_is_restored(told):
    told.restored.set_result(None)
    run(handlers.release(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(told)))
    assert told.calls == [("policy_deleted", "robot")]


def test_a_restore_that_takes_long_is_asked_for_again(monkeypatch, told):
    monkeypatch.setattr(handlers, "RESTORE_TIMEOUT", 0.01)
    with pytest.raises(kopf.TemporaryError, match="not restored yet"):
        run(handlers.release(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(told)))
    assert told.restored.cancelled(), "the runtime may skip an answer that nobody awaits"


def test_without_the_custom_resource_the_operator_says_what_to_do(monkeypatch):
    monkeypatch.setattr(handlers, "ApiServer", lambda: SimpleNamespace(serves_policies=lambda: False))
    with pytest.raises(kopf.PermanentError, match="kubectl apply -f crds/"):
        run(handlers.start(settings=kopf.OperatorSettings(), memo=SimpleNamespace(settings=Settings())))


def test_a_router_that_answers_is_handed_over_and_one_that_does_not_is_not(monkeypatch, told):
    monkeypatch.setattr(handlers, "open_client", lambda *_: None)
    handlers._connect(Settings(), told.runtime, threading.Event())
    assert told.calls == []
    monkeypatch.setattr(handlers, "open_client", lambda *_: "session")
    handlers._connect(Settings(), told.runtime, threading.Event())
    assert told.calls == [("connected", "session")]


# with kopf


class ApiServer(ThreadingHTTPServer):
    """Serves one policy that is being deleted; pods and nodes are only listed when the test allows it."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.pods_allowed, self.nodes_allowed, self.ended = threading.Event(), threading.Event(), threading.Event()
        self.listed = threading.Event()
        self.by_kopf = []
        policy = {
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
        node = {"metadata": {"name": "robot-1", "uid": "uid-node", "resourceVersion": "4"}}
        self.lists = {"contextpolicies": [policy], "pods": [a_pod("slam")], "nodes": [node]}

    def handle_error(self, *_):
        """Kopf ends its watches by hanging up."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        path, _, query = self.path.partition("?")
        plural = path.rpartition("/")[2]
        if plural in ("pods", "nodes") and "kopf" in self.headers["User-Agent"]:
            self.server.by_kopf.append(path)
        if "watch=true" in query:
            self._hold()
        elif plural in self.server.lists:
            self._list(plural)
        else:
            self._answer(DISCOVERY.get(path, {}))

    def do_PATCH(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self._answer(self.server.lists["contextpolicies"][0])

    def log_message(self, *_):
        """Silent."""

    def _list(self, plural):
        gate = {"pods": self.server.pods_allowed, "nodes": self.server.nodes_allowed}.get(plural)
        if gate is not None:
            gate.wait(PATIENCE)
        self._answer({"metadata": {"resourceVersion": "9"}, "items": self.server.lists[plural]})
        if plural == "contextpolicies":
            self.server.listed.set()

    def _hold(self):
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()
        self.server.ended.wait(PATIENCE)
        self.wfile.write(b"0\r\n\r\n")

    def _answer(self, content):
        body = json.dumps(content).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def a_group(name, version):
    served = {"groupVersion": f"{name}/{version}", "version": version}
    return {"name": name, "versions": [served], "preferredVersion": served}


def a_resource(plural, kind, *, namespaced=True):
    verbs = ["list", "watch", "patch", "get"]
    return {"name": plural, "singularName": "", "kind": kind, "namespaced": namespaced, "verbs": verbs}


CRDS = a_resource("customresourcedefinitions", "CustomResourceDefinition", namespaced=False)
CORE = [
    a_resource("pods", "Pod"),
    a_resource("nodes", "Node", namespaced=False),
    a_resource("namespaces", "Namespace", namespaced=False),
    a_resource("events", "Event"),
]
DISCOVERY = {
    "/api": {"versions": ["v1"]},
    "/apis": {"groups": [a_group("contextpolicy.dev", "v1alpha1"), a_group("apiextensions.k8s.io", "v1")]},
    "/api/v1": {"resources": CORE},
    "/apis/apiextensions.k8s.io/v1": {"resources": [CRDS]},
    "/apis/contextpolicy.dev/v1alpha1": {"resources": [a_resource("contextpolicies", "ContextPolicy")]},
}


@pytest.fixture
def server(tmp_path, monkeypatch):
    with ApiServer() as running:
        threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        address = f"http://127.0.0.1:{running.server_port}"
        config = {
            "apiVersion": "v1",
            "kind": "Config",
            "current-context": "test",
            "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test"}}],
            "clusters": [{"name": "test", "cluster": {"server": address}}],
            "users": [{"name": "test", "user": {}}],
        }
        path = tmp_path / "config"
        path.write_text(json.dumps(config))
        monkeypatch.setenv("KUBECONFIG", str(path))
        monkeypatch.setattr(kubernetes.config.kube_config, "KUBE_CONFIG_DEFAULT_LOCATION", str(path))
        yield running
        for event in (running.pods_allowed, running.nodes_allowed, running.ended):
            event.set()
        running.shutdown()


@pytest.fixture
def running(server, monkeypatch, told):
    """What the handlers tell while kopf runs."""
    monkeypatch.setattr(handlers, "Runtime", create_autospec(Runtime, return_value=told.runtime))
    monkeypatch.setattr(handlers, "open_client", lambda *_: None)
    stop = threading.Event()
    operator = threading.Thread(
        target=kopf.run,
        kwargs={
            "registry": handlers.registry,
            "standalone": True,
            "clusterwide": True,
            "stop_flag": stop,
            "memo": kopf.Memo(settings=Settings(live_port=0)),
        },
        daemon=True,  # one that hangs must fail its test, not keep the test run from ending
    )
    operator.start()
    yield told
    stop.set()
    server.ended.set()
    operator.join(PATIENCE)
    assert not operator.is_alive()


def test_nothing_is_done_about_policies_before_all_pods_and_nodes_are_known(server, running):
    """A policy whose containers are not known yet would seem restored, and be gone."""
    server.pods_allowed.set()
    running.wait_for("pod_changed", "slam")
    assert not server.listed.wait(1), "kopf has heard of policies before the nodes are known"
    server.nodes_allowed.set()
    running.wait_for("policy_deleted", "robot")
    assert [name for name, *_ in running.calls] == ["pod_changed", "node_changed", "policy_deleted"]
    assert not server.by_kopf, "kopf is too slow for what changes with every resize"
    running.restored.set_result(None)
