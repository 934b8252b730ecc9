"""Where a machine's CPU went during a run, by the kernel's exact counters.

/proc/stat would not do: it counts who runs at a tick of the clock, and what takes turns with the ticks, as the threads
do that slow processors, is in it far too often or never.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from timelines.demo.cgroup import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

MACHINE, SLOWING = "machine", "slowing"
"""Beside containers: all that runs, and what slows the processors."""


def machine_seconds(root: Path = ROOT) -> float:
    """CPU seconds of all threads so far.

    Under cgroup v2 those of all groups, since the root itself counts ticks there: the kernel's own threads, which are
    in no group, are not in it.
    """
    whole = root / "cpuacct" / "cpuacct.usage"
    if whole.exists():
        return int(whole.read_text()) / 1e9
    return sum(_usage(path.read_text()) for path in root.glob("*/cpu.stat"))


def _usage(statistics: str) -> float:
    return int(dict(line.split() for line in statistics.splitlines())["usage_usec"]) / 1e6


class Account:
    """What was spent while its `with` block ran, in seconds: by the whole `machine`, and by parts of it.

    The machine is looked at first and last, so that its time has all of its parts': what is left is never negative.
    """

    def __init__(self, machine: Callable[[], float], parts: Mapping[str, Callable[[], float]]) -> None:
        self._machine, self._parts = machine, parts
        self.spent: dict[str, float] = {}

    def __enter__(self) -> Self:
        self._whole = self._machine()
        self._before = {name: read() for name, read in self._parts.items()}
        return self

    def __exit__(self, *_: object) -> None:
        spent = {name: read() - self._before[name] for name, read in self._parts.items()}
        self.spent = {MACHINE: round(self._machine() - self._whole, 3), **{k: round(v, 3) for k, v in spent.items()}}
