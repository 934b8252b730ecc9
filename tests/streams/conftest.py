from __future__ import annotations

import pytest

from contextpolicy.streams.loop import Loop


@pytest.fixture
def loop():
    running = Loop()
    yield running
    running.dispose()
