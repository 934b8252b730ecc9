from __future__ import annotations

import pytest

from contextpolicy.agent.cgroup_paths import CgroupPaths, Driver
from contextpolicy.agent.usage import usage


def write(file, text):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def test_cgroup_v2_reads_usage_from_one_file(tmp_path):
    group = tmp_path / "kubepods" / "slam"
    write(group / "cpu.stat", "usage_usec 2500000\nuser_usec 1\nnr_periods 40\nnr_throttled 10\nthrottled_usec 7\n")
    layout = CgroupPaths(tmp_path, 2, Driver.CGROUPFS)
    assert usage(layout, [("a", group)], 7.0) == {
        "at": 7.0,
        "containers": {"a": {"used": 2.5, "periods": 40, "throttled": 10}},
    }


@pytest.mark.parametrize("accounting", ["cpu", "cpuacct"])
def test_cgroup_v1_reads_time_from_cpuacct(tmp_path, accounting):
    group = tmp_path / "cpu" / "kubepods" / "slam"
    write(group / "cpu.stat", "nr_periods 40\nnr_throttled 10\nthrottled_time 7\n")
    write(tmp_path / accounting / "kubepods" / "slam" / "cpuacct.usage", "2500000000\n")
    layout = CgroupPaths(tmp_path / "cpu", 1, Driver.CGROUPFS)
    assert usage(layout, [("a", group)], 7.0)["containers"] == {"a": {"used": 2.5, "periods": 40, "throttled": 10}}


def test_containers_that_have_ended_are_left_out(tmp_path):
    layout = CgroupPaths(tmp_path, 2, Driver.CGROUPFS)
    assert usage(layout, [("a", tmp_path / "gone")], 7.0)["containers"] == {}
