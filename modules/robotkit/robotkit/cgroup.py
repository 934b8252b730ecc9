"""The CPU that a task uses, and how often the kernel has throttled its container because the CPU quota was used up."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path("/sys/fs/cgroup")
OWN = Path("/proc/self/cgroup")


class Throttling(NamedTuple):
    """CFS periods in which the container ran, and those in which it was throttled."""

    periods: int
    throttled: int


class Usage(NamedTuple):
    """Where a task's use is read: its CPU time in ns, and its throttling."""

    cpu: Callable[[], int]
    throttling: Callable[[], Throttling | None]


def own_usage() -> Usage:
    """Of this process and its container."""
    cpu_stat = find_cpu_stat()
    return Usage(time.process_time_ns, lambda: throttling(cpu_stat))


def find_cpu_stat(root: Path = ROOT, own: Path = OWN) -> Path | None:
    """The cpu.stat of this process's cgroup: v2 or v1, seen from inside a container or from the host."""
    try:
        lines = own.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    folders = []
    for controllers, path in (line.split(":", 2)[1:] for line in lines if line.count(":") >= 2):
        mounts = [""] if controllers == "" else [controllers, "cpu"] if "cpu" in controllers.split(",") else []
        folders += [root / mount / path.lstrip("/") for mount in mounts]
    folders += [root, root / "cpu,cpuacct", root / "cpu"]
    stats = (folder / "cpu.stat" for folder in folders)
    return next((stat for stat in stats if throttling(stat) is not None), None)


def throttling(cpu_stat: Path | None) -> Throttling | None:
    """Read the counters; None where nothing is limited or nothing can be read."""
    if cpu_stat is None:
        return None
    try:
        fields = dict(line.split() for line in cpu_stat.read_text(encoding="ascii").splitlines())
        return Throttling(int(fields["nr_periods"]), int(fields["nr_throttled"]))
    except (OSError, ValueError, KeyError):
        return None
