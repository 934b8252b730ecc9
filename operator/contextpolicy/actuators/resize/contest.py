"""Containers that somebody else resizes too: what was taken from us, and when to take it back. Pure.

The last good plan stays in force, so the first time it is put back at once. A writer who insists is answered with
growing pauses: two controllers that correct each other never spin.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import CONTESTED

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import Cpu

QUIET = 30.0
"""Seconds without a foreign change after which the next one is put back at once again."""
REMEMBERED = 90.0
"""Seconds for which a contest counts as going on; an autoscaler that looks once a minute is still at it."""


@dataclass(frozen=True, slots=True)
class Contest:
    """What somebody else did to a container that a policy decides about."""

    by: str
    had: Cpu
    got: Cpu


@dataclass(slots=True)
class Ownership:
    """A container that a policy decides about: `cpu` is what it has by that, `found` what somebody else made of it."""

    policy: str
    cpu: Cpu
    found: Cpu | None = None
    times: int = 0
    seen: float = -inf
    until: float = -inf
    told: bool = False

    def give(self, policy: str, cpu: Cpu) -> None:
        """From now on it has this."""
        self.policy, self.cpu, self.found = policy, cpu, None

    def compare(self, spec: Cpu, now: float) -> bool:
        """Take what somebody else made of it; returns whether it has just been taken from us.

        What it makes of it after that, before we take it back, is one and the same strike.
        """
        if spec == self.found:
            return False
        struck, self.found = self.found is None, spec
        if struck:
            self.times = 0 if now - self.seen > QUIET else self.times + 1
            self.until = now + CONTESTED.after(self.times)
        self.seen = now
        return struck

    @property
    def rests_until(self) -> float:
        """Until when it is left as somebody else has made it."""
        return self.until if self.found is not None else -inf

    @property
    def forgotten_at(self) -> float:
        """When a contest counts as over, unless it goes on."""
        return self.seen + REMEMBERED
