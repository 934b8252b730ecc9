"""What the node changes outside of its root because no setting prevents it; remembered, and undone at the end."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from tests.node.layout import ROOT

MEMORY = ROOT / "traces.json"
# The kubelet's device plugins and links to logs, and the CNI library's cache.
FOLDERS = ("/var/lib/kubelet", "/var/log/containers", "/var/lib/cni")
# The kubelet sets these to the values that it wants.
SYSCTLS = (
    "kernel/keys/root_maxbytes",
    "kernel/keys/root_maxkeys",
    "kernel/panic",
    "kernel/panic_on_oops",
    "vm/overcommit_memory",
    "vm/panic_on_oom",
)


def remember(memory: Path = MEMORY) -> None:
    """Write down how it was before the node's first start; its later starts must not overwrite that."""
    if memory.exists():
        return
    folders = [folder for folder in FOLDERS if not Path(folder).exists()]
    sysctls = {name: _sysctl(name).read_text().strip() for name in SYSCTLS}
    memory.parent.mkdir(parents=True, exist_ok=True)
    memory.write_text(json.dumps({"folders": folders, "sysctls": sysctls}))


def undo(memory: Path = MEMORY) -> None:
    if not memory.exists():
        return
    before = json.loads(memory.read_text())
    for folder in before["folders"]:
        shutil.rmtree(folder, ignore_errors=True)
    for name, value in before["sysctls"].items():
        _sysctl(name).write_text(value)


def _sysctl(name: str) -> Path:
    return Path("/proc/sys") / name
