"""Where the kubelet puts a container's cgroup, for both cgroup versions and both drivers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_UID = re.compile(r"[0-9A-Za-z-]{1,63}")
_CONTAINER = re.compile(r"([a-z-]{1,20})://([0-9a-f]{12,64})")
_SCOPES = {"containerd": "cri-containerd", "cri-o": "crio", "docker": "docker"}


class Driver(StrEnum):
    """The kubelet's cgroup driver, which decides how cgroups are named."""

    CGROUPFS = "cgroupfs"
    SYSTEMD = "systemd"


@dataclass(frozen=True, slots=True)
class CgroupPaths:
    """A node's cgroups: `root` is the mount point of the CPU controller (version 1) or of all (version 2)."""

    root: Path
    version: int
    driver: Driver

    @property
    def top(self) -> Path:
        """The group of all pods."""
        return self.root / ("kubepods" if self.driver is Driver.CGROUPFS else "kubepods.slice")

    def pod(self, qos: str, uid: str) -> Path:
        """A pod's group; those of Guaranteed pods are directly below the top, without a QoS class group between."""
        between = "" if qos == "Guaranteed" else qos.lower()
        if self.driver is Driver.CGROUPFS:
            return self.top / between / f"pod{uid}"
        prefix = f"kubepods-{between}" if between else "kubepods"
        parent = self.top / f"{prefix}.slice" if between else self.top
        return parent / f"{prefix}-pod{uid.replace('-', '_')}.slice"

    def container(self, qos: str, uid: str, container_id: str) -> Path:
        """A container's group."""
        runtime, _, identity = container_id.partition("://")
        scope = _SCOPES.get(runtime, runtime)
        if self.driver is Driver.SYSTEMD:
            return self.pod(qos, uid) / f"{scope}-{identity}.scope"
        return self.pod(qos, uid) / (f"crio-{identity}" if runtime == "cri-o" else identity)


def is_uid(text: str) -> bool:
    """Whether the text has the form of a pod's UID; checked because it becomes part of a path."""
    return _UID.fullmatch(text) is not None


def is_container_id(text: str) -> bool:
    """Whether the text has the form of an API container ID, `containerd://4f0a...`; it becomes part of a path."""
    return _CONTAINER.fullmatch(text) is not None


@lru_cache(maxsize=4096)
def pod_of(container: Path) -> Path:
    """The group of a container's pod; kept, because pathlib takes as long to name it as the kernel to write it."""
    return container.parent


def is_pod(group: Path) -> bool:
    """Whether a group is a pod's, not a container's."""
    return group.name.startswith("pod") or group.suffix == ".slice"


def find_cgroups(mount: Path) -> CgroupPaths | None:
    """The layout below a cgroup mount point; None until the kubelet has created the group of all pods."""
    version = 2 if (mount / "cgroup.controllers").exists() else 1
    roots = (mount,) if version == 2 else (mount / "cpu", mount / "cpu,cpuacct")
    layouts = (CgroupPaths(root, version, driver) for root in roots for driver in Driver)
    return next((layout for layout in layouts if layout.top.is_dir()), None)
