"""Where a machine's CPU went during a run, by the kernel's exact counters.

/proc/stat would not do: it counts what runs at each tick of the clock. Threads that run in step with the ticks, as
those do that slow the processors, would be counted far too often or never.
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

    Under cgroup v2 the sum of all top groups, since the root itself counts ticks there: without the kernel's own
    threads, which are in no group.
    """
    whole = root / "cpuacct" / "cpuacct.usage"
    if whole.exists():
        return int(whole.read_text()) / 1e9
    return sum(_usage(path.read_text()) for path in root.glob("*/cpu.stat"))


def _usage(statistics: str) -> float:
    return int(dict(line.split() for line in statistics.splitlines())["usage_usec"]) / 1e6


class Account:
    """What was spent while its `with` block ran, in seconds: by the whole `machine`, and by parts of it.

    The machine's counter is read first and last, so that it covers the time of all parts, and the rest is not negative.
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
