"""What the health endpoint answers about an agent whose loop hangs."""

from __future__ import annotations

from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from contextpolicy.agent.service import serve


def test_an_agent_that_hangs_is_not_healthy():
    port = serve(0, lambda: False)
    with pytest.raises(HTTPError) as caught:
        urlopen(f"http://127.0.0.1:{port}/healthz", timeout=10)
    with caught.value as answer:
        assert (answer.code, answer.read()) == (503, b"the event loop does not respond\n")
