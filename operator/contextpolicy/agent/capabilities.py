"""What a node can do, and what it lacks for the rest: `probe` reads the facts, `missing` (pure) judges them."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.agent.control_files import CFS, REALTIME, Format
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from contextpolicy.agent.cgroup_paths import CgroupPaths

STATUS = Path("/proc/self/status")
"""The kernel's status of this process; its line CapEff lists the effective capabilities."""
_SYS_NICE = 23
"""CAP_SYS_NICE's number (capability.h)."""


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """What `probe` found; `version` is None until the kubelet has created the group of all pods."""

    version: int | None
    limits: bool = False
    writable: bool = False
    budgets: bool = False
    may_schedule: bool = False
    sees_processes: bool = False


def missing(facts: NodeFacts) -> dict[str, list[str]]:
    """What each scheduler lacks here, with what to do about it; an empty list means that it works."""
    if facts.version is None:
        nothing = ["no pod cgroup (kubepods): the kubelet is not running, or CGROUP_ROOT is not its cgroup mount"]
        return {Scheduler.CFS: nothing, Scheduler.REALTIME: nothing}
    both = [] if facts.writable else ["cgroup files can't be written: mount the node's cgroups read-write, as root"]
    limits = [unlimited(facts)] if unlimited(facts) else []
    return {Scheduler.CFS: [*limits, *both], Scheduler.REALTIME: [*_realtime(facts, facts.version), *both]}


def unlimited(facts: NodeFacts) -> str:
    """Why CPU time can't be limited on the node, even by the kubelet; empty where it can."""
    if facts.version is None or facts.limits:
        return ""
    return (
        f"the kernel has no {CFS[facts.version].file} for pods: build it with CONFIG_CFS_BANDWIDTH=y, and let cgroups "
        "use the CPU controller"
    )


def quota_period(layout: CgroupPaths | None) -> float | None:
    """The kubelet's period of CPU limits in seconds (cpuCFSQuotaPeriod), read from the first limited group; or None."""
    if layout is None:
        return None
    form = CFS[layout.version]
    for folder, _, files in os.walk(layout.top):
        if form.file in files:
            period = _period_of(Path(folder), form)
            if period is not None:
                return period
    return None


def _period_of(group: Path, form: Format) -> float | None:
    """The period of a group in seconds; None without a limit, or when the pod ends while we look."""
    with suppress(OSError):
        quota, *rest = (group / form.file).read_text().split()
        if quota != form.unlimited:
            return int(rest[0] if rest else (group / form.period_file).read_text()) / 1e6
    return None


def _realtime(facts: NodeFacts, version: int) -> list[str]:
    lacks = []
    if not facts.budgets and version == 1:
        lacks.append(
            "the kernel has no realtime group scheduling (no cpu.rt_runtime_us): build it with "
            "CONFIG_RT_GROUP_SCHED=y, or boot it with rt_group_sched=1"
        )
    if not facts.budgets and version == 2:
        lacks.append(
            "cgroup v2 has no realtime budgets (cpu.rt.max) in this kernel: boot with cgroup v1 "
            "(systemd.unified_cgroup_hierarchy=0, kubelet failCgroupV1: false) and CONFIG_RT_GROUP_SCHED=y"
        )
    if not facts.may_schedule:
        lacks.append("the agent may not set scheduling policies (CAP_SYS_NICE): install it with agent.realtime=true")
    if not facts.sees_processes:
        lacks.append("the agent can't see the node's processes (hostPID): install it with agent.realtime=true")
    return lacks


def probe(layout: CgroupPaths | None) -> NodeFacts:
    """Read what the node can do; `layout` is None until the kubelet has created its cgroups."""
    if layout is None:
        return NodeFacts(None)
    limit = layout.top / CFS[layout.version].file
    return NodeFacts(
        version=layout.version,
        limits=limit.exists(),
        writable=os.access(layout.top / "cgroup.procs", os.W_OK),
        budgets=(layout.top / REALTIME[layout.version].file).exists(),
        may_schedule=_has_capability(_SYS_NICE),
        sees_processes=_sees_processes(layout),
    )


def _has_capability(number: int) -> bool:
    lines = STATUS.read_text(encoding="ascii").splitlines()
    effective = next(line for line in lines if line.startswith("CapEff:"))
    return bool(int(effective.split()[1], 16) >> number & 1)


def _sees_processes(layout: CgroupPaths) -> bool:
    """Whether hostPID is set: else processes outside our PID namespace, such as pods' sandboxes, are listed as 0."""
    groups = (Path(folder) for folder, _, files in os.walk(layout.top) if "cgroup.procs" in files)
    return not any("0" in _processes(group) for group in groups)


def _processes(group: Path) -> list[str]:
    """What the group lists; nothing when its pod ends while we look, or where it is threaded (version 2)."""
    with suppress(OSError):
        return (group / "cgroup.procs").read_text().split()
    return []
