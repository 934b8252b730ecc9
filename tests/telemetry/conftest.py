"""A reporter in virtual time."""

from __future__ import annotations

import pytest

from tests.telemetry.reporting import Desk


@pytest.fixture
def desk():
    return Desk()
