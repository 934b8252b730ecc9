"""The end of the node: every process, mount, cgroup and file that it leaves, in an order that works."""

from __future__ import annotations

import shutil

from tests.node import cgroups, components, mounts, processes, traces
from tests.node.layout import ROOT, RUN


def clean(*, keep_state: bool) -> None:
    """End the components, the kubelet before containerd, so that nobody starts again what is ended here."""
    for name in (*reversed(components.names()), *processes.started()):  # the last are those of another datastore
        processes.stop(name)
    processes.kill(processes.shims() | cgroups.pod_processes())
    mounts.remove(ROOT)
    cgroups.remove()
    shutil.rmtree(RUN, ignore_errors=True)
    if not keep_state:
        traces.undo()
        shutil.rmtree(ROOT)
