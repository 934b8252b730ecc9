from __future__ import annotations

import pytest

from robotkit.cgroup import Throttling, find_cpu_stat, throttling

V2 = "usage_usec 1\nnr_periods 20\nnr_throttled 5\nthrottled_usec 7\n"
V1 = "nr_periods 20\nnr_throttled 5\nthrottled_time 7000\n"
UNLIMITED = "usage_usec 1\nuser_usec 1\nsystem_usec 0\n"


@pytest.mark.parametrize(
    ("own", "stat", "text"),
    [
        ("0::/\n", "cpu.stat", V2),  # in a container
        ("0::/kubepods/pod1/abc\n", "kubepods/pod1/abc/cpu.stat", V2),  # on the host
        ("4:cpu,cpuacct:/kubepods/pod1\n0::/\n", "cpu,cpuacct/cpu.stat", V1),  # version 1, in a container
        ("3:cpuacct:/x\n2:cpu:/pod1\n", "cpu/pod1/cpu.stat", V1),  # version 1, on the host
        ("", "cpu.stat", V2),  # no /proc/self/cgroup
    ],
)
def test_every_layout_is_found(tmp_path, own, stat, text):
    root = tmp_path / "cgroup"
    (root / stat).parent.mkdir(parents=True)
    (root / stat).write_text(text)
    (tmp_path / "own").write_text(own)
    found = find_cpu_stat(root, tmp_path / "own")
    assert found == root / stat
    assert throttling(found) == Throttling(20, 5)


def test_without_a_limit_there_is_nothing_to_report(tmp_path):
    (tmp_path / "cpu.stat").write_text(UNLIMITED)
    assert find_cpu_stat(tmp_path, tmp_path / "missing") is None
    assert throttling(None) is None


@pytest.mark.parametrize("text", ["", "nr_periods many\nnr_throttled 1\n", "a b c\n"])
def test_an_invalid_file_reads_as_nothing(tmp_path, text):
    (tmp_path / "cpu.stat").write_text(text)
    assert throttling(tmp_path / "cpu.stat") is None
