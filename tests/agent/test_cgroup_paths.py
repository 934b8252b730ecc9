"""Where containers are: as the kubelet names cgroups with either driver, on either version."""

from __future__ import annotations

from pathlib import Path

import pytest

from contextpolicy.agent.cgroup_paths import CgroupPaths, Driver, find_cgroups, is_container_id, is_pod, is_uid

UID = "59085490-644f-48fd-b15c-b90b7fe0433a"
ID = "ca5b951d4a2732c45bb7331af8586a2a9e4ac82199101c0dc89b330acbe221a8"
V1, V2 = Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup")
SYSTEMD_UID = UID.replace("-", "_")


@pytest.mark.parametrize(("root", "version"), [(V1, 1), (V2, 2)])
@pytest.mark.parametrize(
    ("driver", "qos", "path"),
    [
        (Driver.CGROUPFS, "Burstable", f"kubepods/burstable/pod{UID}/{ID}"),
        (Driver.CGROUPFS, "BestEffort", f"kubepods/besteffort/pod{UID}/{ID}"),
        (Driver.CGROUPFS, "Guaranteed", f"kubepods/pod{UID}/{ID}"),
        (
            Driver.SYSTEMD,
            "Burstable",
            f"kubepods.slice/kubepods-burstable.slice/kubepods-burstable-pod{SYSTEMD_UID}.slice/cri-containerd-{ID}.scope",
        ),
        (
            Driver.SYSTEMD,
            "BestEffort",
            f"kubepods.slice/kubepods-besteffort.slice/kubepods-besteffort-pod{SYSTEMD_UID}.slice/cri-containerd-{ID}.scope",
        ),
        (Driver.SYSTEMD, "Guaranteed", f"kubepods.slice/kubepods-pod{SYSTEMD_UID}.slice/cri-containerd-{ID}.scope"),
    ],
)
def test_a_container_is_below_its_pod_and_class(root, version, driver, qos, path):
    layout = CgroupPaths(root, version, driver)
    group = layout.container(qos, UID, f"containerd://{ID}")
    assert group == root / path
    assert group.is_relative_to(layout.top)
    assert is_pod(group.parent)
    assert not is_pod(group)


@pytest.mark.parametrize(
    ("driver", "runtime", "name"),
    [
        (Driver.SYSTEMD, "cri-o", f"crio-{ID}.scope"),
        (Driver.SYSTEMD, "docker", f"docker-{ID}.scope"),
        (Driver.CGROUPFS, "cri-o", f"crio-{ID}"),
        (Driver.CGROUPFS, "docker", ID),
    ],
)
def test_other_runtimes_have_their_own_names(driver, runtime, name):
    assert CgroupPaths(V2, 2, driver).container("Burstable", UID, f"{runtime}://{ID}").name == name


@pytest.mark.parametrize(
    ("made", "version", "driver"),
    [
        (["cpu/kubepods"], 1, Driver.CGROUPFS),
        (["cpu,cpuacct/kubepods.slice"], 1, Driver.SYSTEMD),
        (["cpu/kubepods", "unified"], 1, Driver.CGROUPFS),
        (["kubepods"], 2, Driver.CGROUPFS),
        (["kubepods.slice", "system.slice"], 2, Driver.SYSTEMD),
    ],
)
def test_a_node_shows_its_version_and_driver(tmp_path, made, version, driver):
    for name in made:
        (tmp_path / name).mkdir(parents=True)
    if version == 2:
        (tmp_path / "cgroup.controllers").touch()
    found = find_cgroups(tmp_path)
    assert found is not None
    assert (found.version, found.driver) == (version, driver)


def test_before_the_kubelet_there_is_no_layout(tmp_path):
    (tmp_path / "cpu").mkdir()
    assert find_cgroups(tmp_path) is None


@pytest.mark.parametrize("text", ["", "../..", "a/b", "x" * 64, "a b", "a\x00"])
def test_path_traversal_is_not_a_uid(text):
    assert not is_uid(text)


@pytest.mark.parametrize(
    "text", ["", ID, f"containerd://{ID}/..", "containerd://../../x", "containerd://", f"a/b://{ID}"]
)
def test_path_traversal_is_not_a_container_id(text):
    assert not is_container_id(text)
