"""The cgroups of a node's pods, for an agent that runs as a plain process."""

from __future__ import annotations

import hashlib
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.agent.cgroup_paths import CgroupPaths, Driver

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

CONTROLLER = Path("/sys/fs/cgroup/cpu")
"""Where cgroup version 1 has CPU limits; without it plain files stand in for the kernel's."""
LIMIT = 40_000
"""Microseconds of 100 ms: what each container begins with."""


def container_id(name: str) -> str:
    """The identity of a pod's container."""
    return f"containerd://{hashlib.sha256(name.encode()).hexdigest()}"


def uid(name: str) -> str:
    """The identity of a pod."""
    return f"uid-{name}"


@contextmanager
def cgroups(place: Path, names: Iterable[str]) -> Iterator[CgroupPaths]:
    """The groups of pods with a container and a sandbox each, at `place` as an agent sees them; removed at the end."""
    place.mkdir()
    real = _kernels()
    if real is None:
        (place / "cpu").mkdir()
    else:
        (place / "cpu").symlink_to(real)
    layout = CgroupPaths(place / "cpu", 1, Driver.CGROUPFS)
    made: list[Path] = []
    try:
        if real is not None:
            made.append(real)
        for name in names:
            container = layout.container("Burstable", uid(name), container_id(name))
            sandbox = container.with_name(container.name[::-1])
            for group in (layout.top, *reversed(container.parents[:2]), container, sandbox):
                if not group.exists():
                    group.mkdir()
                    made.append(group)
                    _begin(group, limited=group in (container, container.parent), real=real is not None)
        yield layout
    finally:
        if real is not None:
            for group in reversed(made):
                group.rmdir()


def _kernels() -> Path | None:
    """A new group of the kernel's; None where there is no such controller or no right to it."""
    group = CONTROLLER / "bench-hops"
    try:
        group.mkdir()
    except OSError:
        return None
    return group


def _begin(group: Path, *, limited: bool, real: bool) -> None:
    """No group but a pod's and a container's has a limit."""
    if not real:
        (group / "cpu.cfs_period_us").write_text("100000\n")
    (group / "cpu.cfs_quota_us").write_text(f"{LIMIT if limited else -1}\n")
