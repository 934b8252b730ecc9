import os

import pytest

from tests.node import processes, shell
from tests.node.errors import ClusterError


def test_a_timeout_kills_the_program_and_its_children(tmp_path, monkeypatch):
    """A builder that was killed alone left an emulated installation behind, which went on for an hour."""
    monkeypatch.setattr(shell, "HEARTBEAT", 0.05)
    said = tmp_path / "log"
    script = "sleep 1000 & echo $!; wait"
    with pytest.raises(ClusterError, match="sleeping: not done after"):
        shell.run_long("sleeping", ["sh", "-c", script], output=said, timeout=2, env=os.environ)
    child = int(said.read_text())
    assert shell.wait_until(lambda: processes.start_time(child) is None, timeout=10)


def test_timeouts_scale_with_patience(tmp_path, monkeypatch):
    monkeypatch.setattr(shell, "PATIENCE", 0.0)
    monkeypatch.setattr(shell, "HEARTBEAT", 0.05)
    with pytest.raises(ClusterError, match="sleeping: not done after 0 s"):
        shell.run_long("sleeping", ["sleep", "10"], output=tmp_path / "log", timeout=60, env=os.environ)
