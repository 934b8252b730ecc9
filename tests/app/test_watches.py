"""What a replica's watches hand to its operator."""

from __future__ import annotations

import json
import threading
from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import Mock

from contextpolicy.app.watches import Watches
from contextpolicy.cluster.paging import Page
from tests.cluster.builders import a_pod
from tests.small_cluster import Recorder
from tests.waiting import PATIENCE

NODE = {"metadata": {"name": "robot-1", "uid": "uid-robot-1", "resourceVersion": "1"}}


class Api:
    """Lists one pod and one node, which are deleted soon."""

    def __init__(self):
        self.ended = threading.Event()
        self._lists = {"pods": [a_pod("slam")], "nodes": [NODE]}

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


def test_pod_and_node_changes_reach_the_operator():
    api, reported = Api(), Recorder()
    watches = Watches(api, ["lab"], reported.operator, Mock())
    watches.start()
    reported.wait_for("pod_gone", "uid-slam")
    reported.wait_for("node_gone", "uid-robot-1")
    watches.stop()
    assert {name for name, *_ in reported.calls} == {"pod_changed", "pod_gone", "node_changed", "node_gone"}
