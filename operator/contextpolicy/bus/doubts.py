"""How long an agent that did not confirm a plan in time is left alone: longer each time in a row. Pure."""

from __future__ import annotations

FIRST, LONGEST = 10.0, 300.0
"""Seconds.

To resize in an agent's place, and to return to it, moves limits or requests of all its pods, and each move costs flash
0.2 MiB: an agent that is always late must not do that every ten seconds. To return at once would quickly revert every
limit, which kubelets get wrong (kubernetes#125205)."""


class Doubts:
    """By node. An agent that was relied on for LONGEST starts from the shortest pause again."""

    def __init__(self) -> None:
        self._times: dict[str, int] = {}
        self._trusted: dict[str, float] = {}
        """When its agent was counted on again, in seconds."""

    def doubt(self, node: str, now: float) -> float:
        """The node's agent was late; returns after how many seconds it may try again."""
        if now - self._trusted.pop(node, now) >= LONGEST:
            del self._times[node]
        times = self._times[node] = self._times.get(node, 0) + 1
        return min(LONGEST, FIRST * 2.0 ** min(times - 1, 20))

    def trust(self, node: str, now: float) -> None:
        """Plans rely on the node's agent again."""
        if node in self._times:
            self._trusted[node] = now

    def forget(self, node: str) -> None:
        """The node is gone."""
        self._times.pop(node, None)
        self._trusted.pop(node, None)
