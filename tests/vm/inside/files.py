"""Files of cgroup v2 that belong to pods, by the names that systemd gives; and what systemd itself knows."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.vm.inside import api

ROOT = Path("/sys/fs/cgroup")


def container_id(pod: str, namespace: str) -> str:
    """The API's name of the pod's first container, such as containerd://4f0a..."""
    identity: str = api.get("pods", pod, namespace)["status"]["containerStatuses"][0]["containerID"]
    return identity


def scope(pod: str, namespace: str) -> Path:
    """The cgroup of the pod's first container, wherever it is: there must be exactly one."""
    name = container_id(pod, namespace).rpartition("/")[2]
    [found] = (ROOT / "kubepods.slice").rglob(f"cri-containerd-{name}.scope")
    return found


def limit(group: Path) -> str:
    """A group's cpu.max without its line end: quota and period in microseconds."""
    return (group / "cpu.max").read_text().strip()


def weight(group: Path) -> int:
    """A group's cpu.weight."""
    return int((group / "cpu.weight").read_text())


def systemctl(*arguments: str) -> str:
    """What systemctl prints."""
    done = subprocess.run(["systemctl", *arguments], capture_output=True, text=True, timeout=300, check=True)
    return done.stdout.strip()
