"""What a CPU limit or a realtime budget means for a busy thread."""

from __future__ import annotations

PERIOD = 0.1
"""Seconds: the kubelet's default period of CPU limits (cpuCFSQuotaPeriod), and ours for realtime budgets. A thread that
has used up its quota waits for the rest of the period. The paper, and the kernel for realtime, use one second."""
SHORTEST, LONGEST = 0.01, 1.0
"""Seconds: the kernel takes 1 ms to 1 s, but a share of 1 % of less than 10 ms is too short for it to measure."""


def throttle_gap(share: int, period: float = PERIOD) -> float:
    """Seconds for which one busy thread may be throttled with this share of one processor, in thousandths."""
    return period * max(0.0, 1 - share / 1000)
