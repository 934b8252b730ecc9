"""Which suspended tasks may still finish the input that they are at. Pure; times are an argument."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

DRAIN = 0.5
"""Seconds in which a suspended task may finish the input that it is at, with the least weight: a quota at once would
freeze it, and with it what a robot has already seen or heard. Measured by `make bench-enforcement`."""


class Drains:
    """Each task's time begins when it is suspended, whatever other plans come meanwhile."""

    def __init__(self) -> None:
        self._due: dict[str, dict[Path, float]] = {}

    def rest(self, policy: str, groups: Iterable[Path], now: float) -> set[Path]:
        """The policy suspends these groups, and no others; returns those that may go on for a while."""
        before = self._due.get(policy, {})
        self._due[policy] = due = {group: before.get(group, now + DRAIN) for group in groups}
        return {group for group, end in due.items() if end > now}

    def next(self, policy: str, now: float) -> float | None:
        """When the next of the policy's groups has had its time; None if all have."""
        return min((end for end in self._due.get(policy, {}).values() if end > now), default=None)

    def forget(self, policy: str) -> None:
        """The policy suspends nothing any more."""
        self._due.pop(policy, None)
