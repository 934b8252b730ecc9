from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.cli import main
from tests.ports import free_port

if TYPE_CHECKING:
    from tests.commands.restoring import Server


@pytest.fixture
def free_endpoint() -> str:
    """An endpoint at which nobody listens yet."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def restore(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run the command; returns the exit code and what it printed."""

    def run(server: Server, *arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("contextpolicy.cluster.api.ApiServer", lambda *_: server)
        code = main(["restore", *arguments])
        assert server.closed
        return code, capsys.readouterr().out

    return run
