"""What kopf does about policies that it can't read: with a real kopf at a small API server."""

from __future__ import annotations

import copy
import json
from concurrent.futures import Future
from threading import Thread
from typing import Any, cast
from unittest.mock import Mock

import kopf
import pytest

from contextpolicy.app import kopf_handlers
from contextpolicy.app.kopf_thread import KopfThread
from contextpolicy.policy.custom_resource import GROUP
from tests.app.kopf_server import KopfServer, a_policy_in
from tests.waiting import until


class Operator:
    """Notes which policies kopf hands over."""

    def __init__(self) -> None:
        self.changed: dict[str, Any] = {}

    def policy_changed(self, body: dict[str, Any]) -> Future[bool]:
        self.changed[body["metadata"]["namespace"]] = body["spec"]
        done: Future[bool] = Future()
        done.set_result(True)
        return done

    def policy_seen(self, body: dict[str, Any]) -> None:
        pass


@pytest.fixture
def serve(monkeypatch):
    """Have kopf serve the policies of these namespaces."""
    registry = copy.deepcopy(kopf_handlers.registry)  # it forgets no handler
    monkeypatch.setattr(kopf_handlers, "registry", registry)
    servers: list[KopfServer] = []
    threads: list[KopfThread] = []

    def serve(lists: dict[str, str]) -> Operator:
        servers.append(KopfServer(lists))
        Thread(target=servers[0].serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        address = f"http://127.0.0.1:{servers[0].server_port}"
        kopf.on.login(registry=registry)(lambda **_: kopf.ConnectionInfo(server=address))
        operator = Operator()
        threads.append(KopfThread(cast("Any", operator), lists, Mock()))
        return operator

    yield serve
    for thread in threads:
        thread.stop()
    for server in servers:
        server.ended.set()
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize("depth", [600, 10_000])
def test_a_policy_that_nests_deeply_keeps_no_other_from_being_served(serve, depth):
    """Kopf copies what it reads, which ends at some 300 levels, and decoding at 990. The API server takes 10,000."""
    deep = json.dumps({**a_policy_in("lab"), "spec": {"example": 5}}).replace("5}", "[" * depth + "]" * depth + "}")
    operator = serve({"lab": deep, "hall": json.dumps(a_policy_in("hall"))})
    until(lambda: operator.changed.keys() == {"lab", "hall"})
    assert json.dumps(operator.changed["lab"])


ANNOTATIONS = {
    "no digest": {"last-handled-configuration": "{"},
    "another digest": {"last-handled-configuration": "5"},
    "a deep digest": {"last-handled-configuration": "[" * 10_000},
    "no progress": {"apply": "{"},
    "another progress": {"apply": "5"},
    "a false time": {"apply": '{"started": "soon"}'},
    "a false number": {"apply": '{"retries": "many"}'},
    "a false purpose": {"apply": '{"purpose": {}, "subrefs": 5}'},
}


@pytest.mark.parametrize("annotations", ANNOTATIONS.values(), ids=ANNOTATIONS)
def test_annotations_that_somebody_else_wrote_do_not_keep_a_policy_from_being_served(serve, annotations):
    policy = a_policy_in("lab")
    policy["metadata"]["annotations"] = {f"{GROUP}/{name}": text for name, text in annotations.items()}
    operator = serve({"lab": json.dumps(policy)})
    until(lambda: operator.changed.keys() == {"lab"})
