"""Python looks through everything that it holds for garbage now and then; meanwhile nobody decides."""

import os
import subprocess
import sys

import pytest

from tests.bus.certificates import signing_keys
from tests.ports import free_port

REPORT = "print(len(gc.get_objects()), gc.get_freeze_count())"
OPERATOR = f"""
import gc
from unittest.mock import Mock
from contextpolicy import cli
from contextpolicy.app import supervisor
def run(stop):
    {REPORT}
    return 0
supervisor.reach, supervisor.Supervisor = Mock(), Mock(return_value=Mock(run=run))
cli.main(["run"])
"""
AGENT = f"""
import gc, threading
from contextpolicy import cli
from contextpolicy.commands import agent
class Stop(threading.Event):
    def wait(self, _):
        {REPORT}
        self.set()
agent.stop_on_signals = Stop
cli.main(["agent"])
"""
"""Each program up to where it waits for what it will decide about; no cluster and no router is there."""


@pytest.mark.parametrize("program", [OPERATOR, AGENT], ids=["operator", "agent"])
def test_startup_objects_are_excluded_from_garbage_collection(program, tmp_path):
    environment = os.environ | {
        "HEALTH_PORT": str(free_port()),
        "METRICS_PORT": str(free_port()),
        "ZENOH_CONNECT": f"tcp/127.0.0.1:{free_port()}",
        "LIVE_PORT": str(free_port()),
        "NODE_NAME": "node",
        "CGROUP_ROOT": str(tmp_path),
        "POD_LOGS": str(tmp_path),
        "STATE_DIRECTORY": str(tmp_path / "state"),
        "PLAN_SIGNING": str(signing_keys(tmp_path / "keys")),
        "PYTHONPATH": "operator",
    }
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    looked_through, spared = map(int, done.stdout.split())
    assert looked_through < spared / 10
