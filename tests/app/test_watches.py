"""What a replica's watches hand to its operator."""

from __future__ import annotations

import json
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from contextpolicy.app.watches import LINGER, Watches
from contextpolicy.cluster.paging import Page
from contextpolicy.errors import ActuationError
from tests.cluster.builders import a_pod
from tests.small_cluster import Recorder
from tests.waiting import PATIENCE, until

NODE = {"metadata": {"name": "robot-1", "uid": "uid-robot-1", "resourceVersion": "1"}}


class Api:
    """Lists one pod, one node and one policy, which are deleted soon."""

    def __init__(self):
        self.ended = threading.Event()
        policy = {"metadata": {**a_policy("lab", "uid-robot")["metadata"], "resourceVersion": "1"}}
        self._lists = {"pods": [a_pod("slam")], "nodes": [NODE], "contextpolicies": [policy]}

    def read_page(self, path, _most):
        return Page({"metadata": {"resourceVersion": "1"}, "items": self._lists[_plural(path)]}, 1)

    def watch(self, path, _):
        gone = [json.dumps({"type": "DELETED", "object": one}).encode() for one in self._lists[_plural(path)]]
        return nullcontext(SimpleNamespace(stream=lambda **_: self._lines(gone), shutdown=self.ended.set))

    def _lines(self, lines):
        yield from (line + b"\n" for line in lines)
        assert self.ended.wait(PATIENCE)


def _plural(path):
    return path.partition("?")[0].rpartition("/")[2]


@pytest.mark.parametrize("namespaces", [["lab"], []], ids=["named", "all"])
def test_changes_of_pods_and_nodes_and_deletions_of_policies_reach_the_operator(namespaces):
    """Kopf does not report policies that were deleted while it could not watch, or without our finalizer."""
    api, reported = Api(), Recorder()
    watches = Watches(api, namespaces, reported.operator, Mock(), time.monotonic)
    watches.start()
    reported.wait_for("pod_gone", "uid-slam")
    reported.wait_for("node_gone", "uid-robot-1")
    reported.wait_for("policy_gone", "uid-robot")
    watches.stop()
    seen = {"pod_changed", "pod_gone", "node_changed", "node_gone", "policy_gone"}
    assert {name for name, *_ in reported.calls} == seen


class Refusing(Api):
    """Forbids listing the policies of the namespace hall."""

    def read_page(self, path, most):
        if "/hall/contextpolicies" in path:
            raise ActuationError("Forbidden", "no right to list", retriable=False)
        return super().read_page(path, most)


def test_namespace_whose_policies_may_not_be_listed_holds_up_no_other():
    watches = Watches(Refusing(), ["lab", "hall"], Recorder().operator, Mock(), time.monotonic)
    watches.start()
    until(lambda: watches.unlisted() == [])
    watches.stop()


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def a_policy(namespace, uid):
    return {"metadata": {"name": "robot", "namespace": namespace, "uid": uid}}


def test_a_namespace_that_is_served_is_kept_for_a_while_without_policies():
    clock = Clock()
    watches = Watches(Api(), [], Recorder().operator, Mock(), clock)
    policies = watches._policies
    policies.on_object(a_policy("lab", "one"))
    policies.on_object(a_policy("lab", "two"))
    policies.on_object(a_policy("hall", "three"))
    policies.on_gone("one")
    assert (watches.served({"lab", "hall"}), watches.next_change()) == ({"lab", "hall"}, None), "it has another"
    policies.on_gone("two")
    clock.now += LINGER - 1
    assert (watches.served({"lab", "hall"}), watches.next_change()) == ({"lab", "hall"}, 1.0)
    clock.now += 1
    assert watches.served({"lab", "hall"}) == {"hall"}
    assert watches.next_change() is None


def test_a_namespace_that_is_not_served_is_not_kept():
    """Another release serves it, or it is being deleted."""
    watches = Watches(Api(), [], Recorder().operator, Mock(), Clock())
    watches._policies.on_object(a_policy("lab", "one"))
    watches._policies.on_gone("one")
    assert watches.served(frozenset()) == set()


def test_a_replica_that_serves_nothing_is_woken_once_for_each_namespace():
    clock = Clock()
    watches = Watches(Api(), [], Recorder().operator, Mock(), clock)
    watches._policies.on_object(a_policy("lab", "one"))
    watches._policies.on_gone("one")
    clock.now += LINGER
    assert [watches.next_change(), watches.next_change()] == [0.0, None]
