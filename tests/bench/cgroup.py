"""A CPU limit for processes of this machine, in cgroup version 1 or 2; needs root."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path("/sys/fs/cgroup")
PERIOD = 100_000
"""Microseconds."""


class Cgroup:
    """A group of its own, without a limit at first."""

    def __init__(self, name: str) -> None:
        self._v1 = (ROOT / "cpu" / "cgroup.procs").exists()
        self.path = (ROOT / "cpu" if self._v1 else ROOT) / f"{name}-{os.getpid()}"
        self.path.mkdir()

    def limit(self, cores: float) -> None:
        """What its processes may use together."""
        quota = round(cores * PERIOD)
        if self._v1:
            (self.path / "cpu.cfs_period_us").write_text(str(PERIOD))
            (self.path / "cpu.cfs_quota_us").write_text(str(quota))
        else:
            (self.path / "cpu.max").write_text(f"{quota} {PERIOD}")

    def outweigh(self) -> None:
        """Other load on the machine hardly counts."""
        name, most = ("cpu.shares", 262_144) if self._v1 else ("cpu.weight", 10_000)
        (self.path / name).write_text(str(most))

    def add(self, pid: int) -> None:
        """Put a process into the group."""
        (self.path / "cgroup.procs").write_text(str(pid))


@contextmanager
def cgroup(name: str) -> Iterator[Cgroup]:
    """Such a group, which is removed at the end."""
    group = Cgroup(name)
    try:
        yield group
    finally:
        time.sleep(0.2)  # the last process may only just have ended
        group.path.rmdir()
