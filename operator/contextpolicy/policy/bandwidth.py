"""What a CPU limit means for a busy thread."""

from __future__ import annotations

PERIOD = 0.1
"""Seconds: the kubelet's default period of limits, and the node agent's of realtime budgets. A thread that used up what
it has waits for the rest of the period."""


def throttle_gap(share: int) -> float:
    """Seconds for which one busy thread may stand still with this share (kernel: bandwidth control)."""
    return PERIOD * max(0.0, 1 - share / 1000)
