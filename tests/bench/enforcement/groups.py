"""The cgroups of the tasks, version 1 or 2: `contextpolicy-enforcement/robot`, and in it one for each task.

Only the controller writes here, and only what changes. The group has the highest weight, so that other work on the
machine hardly counts. The controller itself is in the root group at realtime priority, above any task's: a weight would
not let it write in time while tasks have realtime priority themselves.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Self

from contextpolicy.agent.steps import budget_steps
from contextpolicy.policy.bandwidth import PERIOD
from tests.bench.enforcement.divisions import CORE, REALTIME, Setting
from tests.bench.enforcement.slices import ask_for_slice

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

ROOT = Path("/sys/fs/cgroup")
HIGHEST = 262_144
PERIOD_US = round(PERIOD * 1e6)
PRIORITY, CONTROLLER_PRIORITY = 10, 50


class Groups:
    """The tasks' groups, empty and with nothing set; `with` makes and removes them."""

    def __init__(self, names: Iterable[str], root: Path = ROOT) -> None:
        self.version = 2 if (root / "cgroup.controllers").exists() else 1
        self._controller = root / "cpu" if self.version == 1 else root
        self._top = self._controller / "contextpolicy-enforcement"
        self._robot = self._top / "robot"
        self._groups = {name: self._robot / name for name in names}
        self._origin = self._controller / _own(self.version).lstrip("/")
        self._settings: dict[str, Setting] = {}

    def __enter__(self) -> Self:
        self._remove()  # of a run that was killed
        self._top.mkdir()
        try:
            for parent in (self._controller, self._top, self._robot) if self.version == 2 else ():
                (parent / "cgroup.subtree_control").write_text("+cpu")
            for group in (self._robot, *self._groups.values()):
                group.mkdir()
            self._weigh(self._top, HIGHEST)
            self.reset()
            self._come_first()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        self._join(self._origin)
        self._remove()

    @property
    def realtime(self) -> bool:
        """Whether this kernel gives groups realtime budgets."""
        return (self._top / "cpu.rt_runtime_us").exists()

    def join(self, name: str) -> None:
        """Move the calling process into a task's group."""
        self._join(self._groups[name])

    def begin(self, settings: Mapping[str, Setting], processes: Mapping[str, int]) -> None:
        """Set what holds first; `processes` are the tasks', and in their groups already."""
        self._settings = dict.fromkeys(self._groups, Setting())
        if any(setting.budget for setting in settings.values()):
            for group in (self._top, self._robot):
                (group / "cpu.rt_period_us").write_text(str(PERIOD_US))
                (group / "cpu.rt_runtime_us").write_text(str(REALTIME * PERIOD_US // 1000))
            for group in self._groups.values():
                (group / "cpu.rt_period_us").write_text(str(PERIOD_US))
        self.apply(settings, processes)

    def apply(self, settings: Mapping[str, Setting], processes: Mapping[str, int]) -> None:
        """Write what differs from before."""
        before, self._settings = self._settings, {**self._settings, **settings}
        changed = {name: (before[name], now) for name, now in settings.items()}
        self._schedule(
            {processes[n] for n, (was, now) in changed.items() if was.realtime and not now.realtime}, os.SCHED_OTHER
        )
        self._divide({name: now for name, (was, now) in changed.items() if was.budget != now.budget}, before)
        self._schedule(
            {processes[n] for n, (was, now) in changed.items() if now.realtime and not was.realtime}, os.SCHED_RR
        )
        for name, (was, now) in changed.items():
            group = self._groups[name]
            if was.shares != now.shares:
                self._weigh(group, now.shares)
            if was.quota != now.quota:
                self._limit(group, now.quota)
            if was.processors != now.processors:
                os.sched_setaffinity(processes[name], now.processors)
            if was.slice != now.slice and now.slice is not None:
                ask_for_slice(processes[name], now.slice)

    def reset(self) -> None:
        """Lift limits and weights, so that whatever is left can run and end."""
        for group in self._groups.values():
            self._limit(group, None)
            self._weigh(group, CORE)

    def close_realtime(self) -> None:
        """Give realtime budgets back, once the groups are empty."""
        if self.realtime:
            for group in (*self._groups.values(), self._robot, self._top):
                (group / "cpu.rt_runtime_us").write_text("0")

    def _divide(self, changed: Mapping[str, Setting], before: Mapping[str, Setting]) -> None:
        now = {self._groups[name]: before[name].budget for name in changed}
        for step in budget_steps(now, {self._groups[name]: setting.budget for name, setting in changed.items()}):
            (step.group / "cpu.rt_runtime_us").write_text(str(step.amount * PERIOD_US // 1000))

    def _schedule(self, processes: Iterable[int], policy: int) -> None:
        for process in processes:
            os.sched_setscheduler(process, policy, os.sched_param(PRIORITY if policy == os.SCHED_RR else 0))

    def _come_first(self) -> None:
        self._join(self._controller)
        # Its tasks begin as ordinary processes.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(CONTROLLER_PRIORITY))

    def _join(self, group: Path) -> None:
        (group / "cgroup.procs").write_text(str(os.getpid()))

    def _weigh(self, group: Path, shares: int) -> None:
        if self.version == 1:
            (group / "cpu.shares").write_text(str(shares))
        else:  # as the kubelet converts at pod level
            (group / "cpu.weight").write_text(str(1 + (shares - 2) * 9999 // 262_142))

    def _limit(self, group: Path, quota: int | None) -> None:
        amount = None if quota is None else quota * PERIOD_US // 1000
        if self.version == 1:
            (group / "cpu.cfs_quota_us").write_text(str(-1 if amount is None else amount))
        else:
            (group / "cpu.max").write_text(f"{'max' if amount is None else amount} {PERIOD_US}")

    def _remove(self) -> None:
        for group in (*self._groups.values(), self._robot, self._top):
            if group.exists():
                group.rmdir()


def _own(version: int) -> str:
    """This process's group of the CPU controller."""
    for line in Path("/proc/self/cgroup").read_text(encoding="ascii").splitlines():
        _, controllers, path = line.split(":", 2)
        if (version == 2 and not controllers) or "cpu" in controllers.split(","):
            return path
    raise SystemExit("no CPU controller: mount cgroup version 1 or 2")
