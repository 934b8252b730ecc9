"""What runs the node weighs no more than a service does."""

from __future__ import annotations

import pytest

from timelines.demo.deploy import DeployError
from timelines.experiments.node_service import as_service


class Container:
    """A container under one version of the cgroup hierarchy, of these processes."""

    def __init__(self, version, *processes):
        self.version, self._processes = version, list(processes)

    def processes(self):
        return self._processes


def process(proc, number, parent, cgroup):
    (proc / str(number)).mkdir(parents=True)
    (proc / str(number) / "stat").write_text(f"{number} (a) b) S {parent} 1 1")
    (proc / str(number) / "cgroup").write_text(cgroup)


@pytest.fixture
def proc(tmp_path):
    return tmp_path / "proc"


def check_service(tmp_path, proc, version, file):
    weight = tmp_path / file
    weight.parent.mkdir(parents=True)
    weight.write_text("8192")
    with as_service([Container(version, 11, 10)], tmp_path, proc):
        inside = weight.read_text()
    assert (inside, weight.read_text()) == ({1: "1024", 2: "100"}[version], "8192")


@pytest.fixture
def container(proc):
    """A container whose first process is 10."""
    process(proc, 10, 9, "4:cpu,cpuacct:/kubepods/x\n")
    process(proc, 11, 10, "4:cpu,cpuacct:/kubepods/x\n")


@pytest.mark.usefixtures("container")
def test_the_shims_group_weighs_what_a_service_does_and_then_what_it_did(tmp_path, proc):
    process(proc, 9, 1, "5:memory:/m\n4:cpu,cpuacct:/node\n0::/\n")
    check_service(tmp_path, proc, 1, "cpu/node/cpu.shares")


@pytest.mark.usefixtures("container")
def test_under_version_2_too(tmp_path, proc):
    process(proc, 9, 1, "0::/system.slice/k3s.service\n")
    check_service(tmp_path, proc, 2, "system.slice/k3s.service/cpu.weight")


@pytest.mark.usefixtures("container")
@pytest.mark.parametrize("processes", [[], [10]])
def test_a_node_without_a_group_of_its_own_is_refused(tmp_path, proc, processes):
    process(proc, 9, 1, "4:cpu,cpuacct:/\n")
    service = as_service([Container(1, *processes)], tmp_path, proc)
    with pytest.raises(DeployError, match="no CPU group of its own"), service:
        pass
