"""The limit of what is possible: this process writes the cgroup file itself."""

from __future__ import annotations

import os
import time
from itertools import cycle
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.bench.reaction.stopwatch import Stopwatch
    from timelines.demo.cgroup import Cgroup

CORES = (0.3, 0.4)
"""Below the limit of the pod, which the kernel would not let a container exceed."""


class DirectWrite:
    """One container's limit to and fro."""

    name = "direct cgroup write"

    def __init__(self, group: Cgroup, stopwatch: Stopwatch) -> None:
        self._group, self._stopwatch, self._next = group, stopwatch, cycle(CORES)
        stopwatch.watch(group)
        self._file = os.open(group.quota_file, os.O_WRONLY)

    def go(self) -> dict[str, float]:
        """Milliseconds to each stage."""
        cores = next(self._next)
        period = int(self._group.period_file.read_text()) if self._group.period_file else 100_000
        quota = f"{round(cores * period)}" + ("" if self._group.period_file else f" {period}")
        began = time.time()
        os.write(self._file, quota.encode())
        seen = self._stopwatch.wait({self._group: cores}, began, 1.0)
        return {"cgroup": (seen[self._group] - began) * 1e3}

    def close(self) -> None:
        """Let go of the file."""
        os.close(self._file)
