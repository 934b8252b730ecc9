"""The end of the node: every process, mount, cgroup, namespace and file that it leaves, in an order that works."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.cluster import cgroups, components, mounts, network, processes
from tests.cluster.layout import ROOT, RUN

CNI_STATE = Path("/var/lib/cni")
CONTAINER_LOGS = Path("/var/log/containers")


def clean(*, keep_state: bool) -> None:
    """The kubelet goes first, so that nobody starts anew what is ended here."""
    for one in reversed(components.all_components()):
        processes.stop(one.name)
    processes.kill(processes.shims() | cgroups.pod_processes())
    mounts.remove(ROOT)
    cgroups.remove()
    network.forget_cni_results(CNI_STATE)
    _remove_log_links(CONTAINER_LOGS, target=ROOT)
    shutil.rmtree(RUN, ignore_errors=True)
    if not keep_state:
        shutil.rmtree(ROOT)


def _remove_log_links(folder: Path, *, target: Path) -> None:
    """Remove the kubelet's links to our pods' logs; where it makes them cannot be configured."""
    for link in folder.glob("*.log"):
        if link.is_symlink() and link.readlink().is_relative_to(target):
            link.unlink()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
