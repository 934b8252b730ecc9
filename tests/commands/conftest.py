from __future__ import annotations

import pytest

from tests.ports import free_port


@pytest.fixture
def free_endpoint() -> str:
    """An endpoint at which nobody listens yet."""
    return f"tcp/127.0.0.1:{free_port()}"
