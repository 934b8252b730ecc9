"""The agent and systemd write the same file: limits on systemd's own units, without a node."""

import subprocess
import uuid

import pytest

from contextpolicy.agent.control_files import CFS, ControlFiles
from contextpolicy.agent.inotify import WriteWatch
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.limits import Limits
from tests.e2e.cluster import until
from tests.vm.inside.files import ROOT, limit, systemctl

POLICY = "robot/robot"
BEFORE, OURS = "50000 100000", "39000 100000"


@pytest.fixture
def group():
    """A container's scope in a pod's slice, both with half a core, as the kubelet has them made."""
    name = uuid.uuid4().hex
    slice_name, scope = f"agent-pod{name}.slice", f"agent-{name}.scope"
    quota = ("--property=CPUQuota=50%", "--property=CPUQuotaPeriodSec=100ms")
    argv = ["systemd-run", "--scope", f"--unit={scope}", f"--slice={slice_name}", *quota, "sleep", "infinity"]
    folder = ROOT / "agent.slice" / slice_name / scope
    with subprocess.Popen(argv) as process:
        until("the scope is there", folder.is_dir)
        systemctl("set-property", "--runtime", slice_name, "CPUQuota=50%", "CPUQuotaPeriodSec=100ms")
        until("both have half a core", lambda: [limit(folder), limit(folder.parent)] == [BEFORE, BEFORE])
        yield folder
        systemctl("stop", scope, slice_name)
        process.wait(600)


class Agent(Limits):
    """The part of the agent that writes limits and hears of other writers; `heard` is what those wrote."""

    def __init__(self, journal):
        self.heard: list[str] = []
        super().__init__(ControlFiles(CFS[2], WriteWatch(self)), Ledger(journal))

    def plan(self, group):
        self.apply(POLICY, {group: 390}, (), {group: 500})

    def on_write(self, path, heard):
        self.heard.append(path.read_text().strip())
        self.on_other_write(path, heard)


@pytest.fixture
def agent(tmp_path):
    limits = Agent(tmp_path / "journal")
    yield limits
    limits.release(POLICY)


def test_setting_a_unit_property_keeps_the_agents_limit(group, agent):
    """systemd rewrites all CPU settings of the unit, and so the limit from before ours."""
    agent.plan(group)
    assert limit(group) == OURS
    systemctl("set-property", "--runtime", group.name, "CPUWeight=50")
    until("systemd has written what it knew", lambda: BEFORE in agent.heard or agent.heard)
    until("ours is back", lambda: limit(group) == OURS or limit(group))
    agent.release(POLICY)
    assert [limit(group), limit(group.parent)] == [BEFORE, BEFORE]


def test_reloading_systemd_keeps_the_agents_limit(group, agent):
    agent.plan(group)
    systemctl("daemon-reload")
    systemctl("daemon-reexec")
    until("ours is in force", lambda: limit(group) == OURS or limit(group))


def test_a_limit_set_through_systemd_is_kept(group, agent):
    """Like another writer's resize, it stays until the next plan."""
    agent.plan(group)
    systemctl("set-property", "--runtime", group.name, "CPUQuota=20%")
    until("the owner's is in force", lambda: limit(group) == "20000 100000" or limit(group))
    agent.release(POLICY)
    assert limit(group) == "20000 100000"
