"""What a node lacks, in words that help."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.agent import capabilities
from contextpolicy.agent.capabilities import NodeFacts, missing, probe, quota_period, unlimited
from tests.agent.builders import CHAT, SLAM, Tree

ALL = NodeFacts(1, limits=True, writable=True, budgets=True, may_schedule=True, sees_processes=True)


@pytest.mark.parametrize("version", [1, 2])
def test_fully_capable_node_lacks_nothing(version):
    assert missing(replace(ALL, version=version)) == {"CFS": [], "Realtime": []}


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        ({"budgets": False}, "CONFIG_RT_GROUP_SCHED"),
        ({"budgets": False, "version": 2}, "cgroup v2 has no realtime budgets"),
        ({"may_schedule": False}, "CAP_SYS_NICE"),
        ({"sees_processes": False}, "hostPID"),
    ],
)
def test_limits_work_without_realtime(change, hint):
    lacks = missing(replace(ALL, **change))
    assert lacks["CFS"] == []
    assert len(lacks["Realtime"]) == 1
    assert hint in lacks["Realtime"][0]


@pytest.mark.parametrize(
    ("change", "hint"), [({"limits": False}, "CONFIG_CFS_BANDWIDTH"), ({"writable": False}, "root")]
)
def test_missing_requirement_for_limits_is_reported(change, hint):
    assert hint in missing(replace(ALL, **change))["CFS"][0]


def test_missing_kubepods_group_is_reported():
    assert all("kubepods" in lacks[0] for lacks in missing(NodeFacts(None)).values())


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("realtime", [True, False])
def test_a_probe_looks_at_the_kernels_files(tmp_path, version, realtime):
    found = probe(Tree(tmp_path, version, realtime=realtime).layout)
    assert (found.version, found.limits, found.writable, found.budgets) == (version, True, True, realtime)


def test_processes_of_another_namespace_are_noticed(tmp_path):
    tree = Tree(tmp_path)
    group = tree.container(SLAM)
    assert probe(tree.layout).sees_processes
    (group / "cgroup.procs").write_text("0\n17\n")
    assert not probe(tree.layout).sees_processes


@pytest.mark.parametrize(
    ("effective", "found"), [("0000000000800000", True), ("000001ffff7fffff", False), ("0", False)]
)
def test_the_right_to_schedule_is_read_from_the_process(tmp_path, monkeypatch, effective, found):
    """CAP_SYS_NICE is bit 23; what the process may ever get (permitted, bounding) does not count."""
    status = tmp_path / "status"
    status.write_text(f"CapPrm:\t000001ffffffffff\nCapEff:\t{effective}\nCapBnd:\t000001ffffffffff\n")
    monkeypatch.setattr(capabilities, "STATUS", status)
    assert probe(Tree(tmp_path).layout).may_schedule is found


def test_proc_status_has_the_effective_capabilities():
    assert [line for line in capabilities.STATUS.read_text().splitlines() if line.startswith("CapEff:\t")]


@pytest.mark.parametrize("version", [1, 2])
def test_the_kubelets_period_is_found_in_the_first_limit(tmp_path, version):
    tree = Tree(tmp_path, version)
    assert quota_period(tree.layout) is None
    tree.container(CHAT, limit=None)
    assert quota_period(tree.layout) is None
    tree.container(SLAM)
    assert quota_period(tree.layout) == 0.1
    assert quota_period(None) is None


@pytest.mark.parametrize(("version", "file"), [(1, "cpu.cfs_quota_us"), (2, "cpu.max")])
def test_kernel_without_bandwidth_control_is_reported(version, file):
    without = replace(ALL, version=version, limits=False)
    assert unlimited(without).startswith(f"the kernel has no {file} for pods: build it with CONFIG_CFS_BANDWIDTH=y")
    assert unlimited(replace(without, limits=True)) == unlimited(NodeFacts(None)) == ""
    assert unlimited(replace(ALL, writable=False)) == ""


def test_group_that_ends_while_it_is_read_is_left_out(tmp_path):
    """Or one that can't be: a threaded group has no list of processes (EOPNOTSUPP)."""
    tree = Tree(tmp_path)
    processes = tree.container(SLAM) / "cgroup.procs"
    processes.unlink(missing_ok=True)
    processes.symlink_to("gone")
    assert probe(tree.layout).sees_processes
