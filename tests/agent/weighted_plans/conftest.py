"""A node in every layout."""

from __future__ import annotations

import pytest

from contextpolicy.agent import capabilities
from tests.agent.builders import LAYOUTS
from tests.agent.weighted_plans.node import Node


@pytest.fixture(autouse=True)
def _able(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)


@pytest.fixture(params=LAYOUTS, ids=str)
def node(request, tmp_path):
    return Node(tmp_path, request.param)
