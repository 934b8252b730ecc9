"""Limits on a node in every layout, and the journal that outlives them."""

from __future__ import annotations

import pytest

from tests.agent.limits.planned import Planned


@pytest.fixture
def journal(tmp_path):
    return tmp_path / "journal"


@pytest.fixture
def live(tree, journal):
    return lambda: Planned(tree, journal)


@pytest.fixture
def limits(live):
    return live()
