"""The CPU time of the other processes that we see: in a pod with `shareProcessNamespace`, those of its containers."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from robotkit.errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable

PROC = Path("/proc")


class OtherProcesses:
    """Answers with the ns that they have used since we were made; a process that ended keeps what was read of it."""

    def __init__(
        self, proc: Path = PROC, used: Callable[[int], int] = lambda pid: time.clock_gettime_ns(clock_of(pid))
    ) -> None:
        self._proc, self._used = proc, used
        self._last = self._read()
        self._total = 0
        if not self._last:
            raise ConfigurationError("no other process can be seen: expected shareProcessNamespace: true in the pod")

    def __call__(self) -> int:
        """Add what each has used since it was last asked."""
        now = self._read()
        for pid, used in now.items():
            before = self._last.get(pid, 0)
            self._total += (
                used - before if used >= before else used
            )  # another process with the number of one that ended
        self._last = now
        return self._total

    def _read(self) -> dict[int, int]:
        found = {}
        for pid in (int(path.name) for path in self._proc.iterdir() if path.name.isdecimal()):
            try:
                if pid != os.getpid():
                    found[pid] = self._used(pid)
            except OSError:  # it has ended meanwhile
                continue
        return found


def clock_of(pid: int) -> int:
    """The clock of a process's CPU time, all its threads together, as clock_getcpuclockid(3) makes it on Linux."""
    return (~pid << 3) | 2
