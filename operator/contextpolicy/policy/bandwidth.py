"""What a CPU limit or a realtime budget means for a busy thread."""

from __future__ import annotations

PERIOD = 0.1
"""Seconds: the kubelet's default period of limits (cpuCFSQuotaPeriod), and that of realtime budgets here. A thread that
used up what it has waits for the rest of the period. The paper's, and the kernel's own for realtime, is a second."""
SHORTEST, LONGEST = 0.01, 1.0
"""Seconds: the kernel takes 1 ms to 1 s, but of less than 10 ms a task's 1 % would be below what it can measure."""


def throttle_gap(share: int, period: float = PERIOD) -> float:
    """Seconds for which one busy thread may stand still with this share (kernel: bandwidth control)."""
    return period * max(0.0, 1 - share / 1000)
