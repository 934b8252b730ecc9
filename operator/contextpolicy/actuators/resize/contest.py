"""Containers that somebody else resizes too: what they changed, and when to change it back. Pure.

The last good plan stays in force, so the first foreign change is reverted at once. A writer who insists is answered
after growing pauses, so that two controllers that correct each other never spin.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import CONTESTED

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import Cpu

QUIET = 30.0
"""Seconds without a foreign change after which the next one is reverted at once again."""
REMEMBERED = 90.0
"""Seconds after the last foreign change until a contest counts as over; an autoscaler may act only once a minute."""


@dataclass(frozen=True, slots=True)
class Contest:
    """A foreign change of a container that a policy decides about: by whom, from what, to what."""

    by: str
    had: Cpu
    got: Cpu


@dataclass(slots=True)
class Ownership:
    """A container that a policy decides about: `cpu` is what the policy gave it, `found` a foreign change in place.

    `times` counts strikes after the first, `seen` is the last change, `until` when to revert it. `told`: the
    contest was reported.
    """

    policy: str
    cpu: Cpu
    found: Cpu | None = None
    times: int = 0
    seen: float = -inf
    until: float = -inf
    told: bool = False

    def give(self, policy: str, cpu: Cpu) -> None:
        """The policy's resources are in the API (again): the foreign change, if any, is over."""
        self.policy, self.cpu, self.found = policy, cpu, None

    def compare(self, spec: Cpu, now: float) -> bool:
        """Note what somebody else set; returns whether this is a new strike.

        Further foreign changes before we revert the first belong to the same strike.
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
        """Until when the foreign change is left in place."""
        return self.until if self.found is not None else -inf

    @property
    def forgotten_at(self) -> float:
        """When the contest counts as over, unless it goes on."""
        return self.seen + REMEMBERED
