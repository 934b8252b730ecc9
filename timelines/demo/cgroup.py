"""What the kernel enforces for a container, read from its cgroup (v1 or v2), whatever runtime created it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.agent import weight_units

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path("/sys/fs/cgroup")


@dataclass(frozen=True, slots=True)
class Cgroup:
    """One container's CPU controller files."""

    quota_file: Path
    period_file: Path | None
    usage_file: Path

    def limit(self) -> float | None:
        """Cores that the quota allows; None without a quota or when the container is gone."""
        try:
            words = self.quota_file.read_text().split()
            period = self.period_file.read_text() if self.period_file else words[1]
        except OSError:
            return None
        return None if words[0] in ("max", "-1") else int(words[0]) / int(period)

    def weight(self) -> int | None:
        """The weight of the container's pod, where pods compete: shares (v1) or weight (v2); None when it is gone."""
        name = weight_units.FILES[self.version]
        try:
            return int((self.quota_file.parent.parent / name).read_text())
        except OSError:
            return None

    @property
    def version(self) -> int:
        """Of the cgroup hierarchy."""
        return 1 if self.period_file else 2

    def usage(self) -> float:
        """Seconds of CPU used so far; 0 when the container is gone."""
        try:
            text = self.usage_file.read_text()
        except OSError:
            return 0.0
        if self.usage_file.name == "cpuacct.usage":
            return int(text) / 1e9
        return int(dict(line.split() for line in text.splitlines())["usage_usec"]) / 1e6

    def throttling(self) -> dict[str, float]:
        """Periods so far, those in which it was throttled, and for how many seconds; empty when it is gone."""
        try:
            text = (self.quota_file.parent / "cpu.stat").read_text()
        except OSError:
            return {}
        found = {name: int(value) for name, value in (line.split() for line in text.splitlines())}
        stopped = found.get("throttled_time", 0) / 1e9 + found.get("throttled_usec", 0) / 1e6  # cgroup v1, or v2
        periods, throttled = float(found.get("nr_periods", 0)), float(found.get("nr_throttled", 0))
        return {"periods": periods, "throttled": throttled, "throttledTime": stopped}

    def processes(self) -> list[int]:
        """The ids of its processes."""
        try:
            return [int(line) for line in (self.quota_file.parent / "cgroup.procs").read_text().split()]
        except OSError:
            return []


def find(container_id: str, root: Path = ROOT) -> Cgroup | None:
    """A container's cgroup by its id (`containerd://<hex>` or `<hex>`) anywhere below kubepods; None if not found."""
    name = container_id.rpartition("/")[2]
    v1 = (root / "cpu").is_dir()
    folder = next(_folders(root / "cpu" if v1 else root, name), None)
    if folder is None:
        return None
    if not v1:
        return Cgroup(folder / "cpu.max", None, folder / "cpu.stat")
    accounting = root / "cpuacct" / folder.relative_to(root / "cpu")
    return Cgroup(folder / "cpu.cfs_quota_us", folder / "cpu.cfs_period_us", accounting / "cpuacct.usage")


def _folders(hierarchy: Path, name: str) -> Iterator[Path]:
    for kubepods in hierarchy.glob("kubepods*"):
        for folder, _, _ in os.walk(kubepods):
            if name in Path(folder).name:
                yield Path(folder)
