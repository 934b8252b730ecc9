"""What containers have used so far, from their cgroups; read only on request."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from contextpolicy.agent.cgroup_paths import CgroupPaths


def usage(layout: CgroupPaths, groups: Iterable[tuple[str, Path]], now: float) -> dict[str, Any]:
    """Totals of each container (ID and group) `now`, in monotonic seconds; those that have ended are left out."""
    containers = {}
    for container, group in groups:
        try:
            containers[container] = _totals(layout, group)
        except (OSError, ValueError, KeyError):
            continue
    return {"at": now, "containers": containers}


def _totals(layout: CgroupPaths, group: Path) -> dict[str, float]:
    stat = dict(line.split() for line in (group / "cpu.stat").read_text().splitlines())
    return {
        "used": int(stat["usage_usec"]) / 1e6 if layout.version == 2 else _used(layout, group),
        "periods": int(stat["nr_periods"]),
        "throttled": int(stat["nr_throttled"]),
    }


def _used(layout: CgroupPaths, group: Path) -> float:
    """Version 1 counts time in another controller, which may be mounted with the CPU's or beside it."""
    inside = group.relative_to(layout.root)
    for root in (layout.root, layout.root.parent / "cpuacct", layout.root.parent / "cpu,cpuacct"):
        file = root / inside / "cpuacct.usage"
        if file.exists():
            return int(file.read_text()) / 1e9
    raise FileNotFoundError(group / "cpuacct.usage")
