"""Whether anybody else is at work on this machine: a measurement beside a compiler says nothing."""

from __future__ import annotations

import time
from pathlib import Path

LOOK = 0.25
IDLE_ENOUGH = 0.8
"""Part of all processors' time that has to be idle; the node's own components take a tenth."""
PATIENCE = 60.0
BUDGET = 900.0
"""Seconds to wait for one quiet moment, and for all of them together."""


class Quiet:
    """Waits for quiet moments, as long as there is patience left."""

    def __init__(self, budget: float) -> None:
        self.disturbed = 0
        self._left = budget

    def wait(self) -> None:
        """Wait for a quiet moment; that there was none is counted."""
        began = time.monotonic()
        deadline = began + min(PATIENCE, self._left)
        while (busy := _idle() < IDLE_ENOUGH) and time.monotonic() < deadline:
            pass
        self.disturbed += busy
        self._left -= time.monotonic() - began


def _idle() -> float:
    """How much of the next moment is idle."""
    before = _times()
    time.sleep(LOOK)
    spent = [now - then for now, then in zip(_times(), before, strict=True)]
    return sum(spent[3:5]) / max(1, sum(spent))


def _times() -> list[int]:
    """Ticks since boot: user, nice, system, idle, iowait, irq, softirq, steal."""
    first = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0]
    return [int(ticks) for ticks in first.split()[1:9]]
