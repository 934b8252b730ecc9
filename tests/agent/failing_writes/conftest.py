"""A node in every layout."""

from __future__ import annotations

import pytest

from contextpolicy.agent import capabilities, threads
from tests.agent.builders import (
    LAYOUTS,
    Tree,
)
from tests.agent.failing_writes.node import Node


@pytest.fixture(params=LAYOUTS, ids=str)
def node(request, tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)
    return Node(Tree(tmp_path / "cgroup", *request.param), tmp_path / "state", monkeypatch)


@pytest.fixture
def _threads(monkeypatch):
    """No test may change real threads."""
    monkeypatch.setattr(threads, "make_realtime", lambda *_: None)
    monkeypatch.setattr(threads, "make_ordinary", lambda *_: None)
