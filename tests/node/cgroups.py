"""The cgroups that the node uses: one for its own components, and the kubelet's tree of pods."""

from __future__ import annotations

import os
from pathlib import Path

from tests.node.errors import ClusterError
from tests.node.layout import CGROUP_DRIVER_VARIABLE
from tests.node.shell import wait_until

MOUNT = Path("/sys/fs/cgroup")
COMPONENTS = "contextpolicy-node"
SERVICE = MOUNT / "system.slice" / f"{COMPONENTS}.service"
PODS = "kubepods"
# Eight times a default group's and, on two cores, four times all pods' together: the control plane answers
# while the pods saturate the node.
SHARES = 8192
WEIGHT = 800


DRIVERS = ("cgroupfs", "systemd")


def driver() -> str:
    """Who makes the pods' cgroups: the kubelet and runc themselves if the environment says nothing, or systemd."""
    chosen = os.environ.get(CGROUP_DRIVER_VARIABLE) or "cgroupfs"
    if chosen not in DRIVERS:
        raise ClusterError(f"{CGROUP_DRIVER_VARIABLE}={chosen}: it is one of {', '.join(DRIVERS)}")
    return chosen


def components_folder() -> Path:
    """Return the CPU group of the components: where systemd runs the node, as it runs k3s, that of the service."""
    if driver() == "systemd":
        return SERVICE
    return (MOUNT / "cpu" if (MOUNT / "cpu").is_dir() else MOUNT) / COMPONENTS


def create() -> None:
    """Create the components' group; systemd creates its own."""
    if driver() == "systemd":
        return
    folder = components_folder()
    folder.mkdir(exist_ok=True)
    if (folder / "cpu.shares").exists():
        (folder / "cpu.shares").write_text(str(SHARES))
    else:
        (folder / "cpu.weight").write_text(str(WEIGHT))


def _hierarchies() -> list[Path]:
    return [MOUNT, *(path for path in MOUNT.iterdir() if path.is_dir() and not path.is_symlink())]


def pod_trees() -> list[Path]:
    return [path / PODS for path in _hierarchies() if (path / PODS).is_dir()]


def pod_processes() -> set[int]:
    files = (file for tree in pod_trees() for file in tree.rglob("cgroup.procs"))
    return {int(pid) for file in files for pid in _read(file).split()}


def _read(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:
        return ""  # the group went away with its last process, or is threaded and has no list


def remove() -> None:
    """Remove the groups from the leaves up; one that was just emptied takes a moment."""
    trees = [*pod_trees(), *(path / COMPONENTS for path in _hierarchies())]
    for tree in trees:
        if not wait_until(lambda tree=tree: _removed(tree), timeout=10):  # type: ignore[misc]
            raise ClusterError(f"{tree}: still in use by processes {_read(tree / 'cgroup.procs').split()}")


def _removed(tree: Path) -> bool:
    for folder, _, _ in os.walk(tree, topdown=False):
        try:
            Path(folder).rmdir()
        except OSError:
            return False
    return not tree.exists()
