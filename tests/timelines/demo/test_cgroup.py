"""The kernel's files, from a tree that looks like a node's."""

from __future__ import annotations

import pytest

from timelines.demo.cgroup import find

ID = "8f2a" * 16
V1_POD = "kubepods/burstable/pod1234-56"
V2_POD = "kubepods.slice/kubepods-burstable.slice/kubepods-burstable-pod1234_56.slice"


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.fixture
def v1(tmp_path):
    """cgroup v1 with the cgroupfs driver; the accounting has a hierarchy of its own."""
    folder = tmp_path / "cpu" / V1_POD / ID
    write(folder / "cpu.cfs_quota_us", "30000\n")
    write(folder / "cpu.cfs_period_us", "100000\n")
    write(folder / "cgroup.procs", "17\n18\n")
    write(tmp_path / "cpuacct" / V1_POD / ID / "cpuacct.usage", "1500000000\n")
    return tmp_path


@pytest.fixture
def v2(tmp_path):
    """cgroup v2 with the systemd driver."""
    folder = tmp_path / V2_POD / f"cri-containerd-{ID}.scope"
    write(folder / "cpu.max", "30000 100000\n")
    write(folder / "cpu.stat", "usage_usec 1500000\nuser_usec 1\nsystem_usec 2\n")
    write(folder / "cgroup.procs", "17\n18\n")
    return tmp_path


@pytest.fixture(params=["v1", "v2"])
def root(request):
    return request.getfixturevalue(request.param)


def quota_file(root):
    return next(path for name in ("cpu.cfs_quota_us", "cpu.max") for path in root.rglob(name))


@pytest.mark.parametrize("container", [ID, f"containerd://{ID}"])
def test_a_container_is_found_by_its_id_and_read(root, container):
    cgroup = find(container, root)
    assert cgroup is not None
    assert (cgroup.limit(), cgroup.usage(), cgroup.processes()) == (0.3, 1.5, [17, 18])


def test_a_pods_weight_is_read_beside_its_containers(root):
    cgroup = find(ID, root)
    assert cgroup is not None
    assert cgroup.weight() is None
    name = "cpu.shares" if cgroup.version == 1 else "cpu.weight"
    write(quota_file(root).parent.parent / name, "512\n")
    assert cgroup.weight() == 512


def test_a_limit_that_moves_is_read_again(root):
    cgroup = find(ID, root)
    assert cgroup is not None
    quota_file(root).write_text("100000 100000\n" if "cpu.max" in str(quota_file(root)) else "100000\n")
    assert cgroup.limit() == 1.0


@pytest.mark.parametrize(("fixture", "text"), [("v1", "-1\n"), ("v2", "max 100000\n")])
def test_no_quota_means_no_limit(fixture, text, request):
    root = request.getfixturevalue(fixture)
    quota_file(root).write_text(text)
    cgroup = find(ID, root)
    assert cgroup is not None
    assert cgroup.limit() is None


def test_a_container_that_is_gone_has_nothing(root):
    cgroup = find(ID, root)
    assert cgroup is not None
    for path in sorted(root.rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()
    assert (cgroup.limit(), cgroup.usage(), cgroup.processes()) == (None, 0.0, [])


def test_an_unknown_container_is_not_found(root):
    assert find("containerd://0000", root) is None


def test_a_node_without_pods(tmp_path):
    assert find(ID, tmp_path) is None
    (tmp_path / "cpu").mkdir()
    assert find(ID, tmp_path) is None
