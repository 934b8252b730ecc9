"""Containers that another client also resizes: what it changed, and when to revert it. Pure.

The last good plan stays in force, so the first foreign change is reverted at once. Further ones are reverted after
growing pauses, so that two controllers that correct each other never spin. After STRIKES of them the operator yields:
the change stays in place, and is reverted once in a while to see whether the writer persists.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import CONFLICTING

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import Cpu

QUIET = 30.0
"""Seconds without a foreign change after which the next one is reverted at once again."""
REMEMBERED = 90.0
"""Seconds after the last foreign change until a conflict counts as over; an autoscaler may act only once a minute."""


STRIKES = 10
"""How many foreign changes of one conflict are reverted: half a minute of a client that keeps writing, ten minutes
of an autoscaler that acts once a minute."""
YIELDED = 600.0
"""Seconds for which any further change is left in place."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """A foreign change of a container that a policy decides about: by whom, from what, to what.

    `yielded`: it is left in place for YIELDED seconds.
    """

    by: str
    had: Cpu
    got: Cpu
    yielded: bool = False


@dataclass(slots=True)
class Ownership:
    """A container that a policy decides about: `cpu` is what the policy gave it, `found` a foreign change in place.

    `strikes` counts those of this conflict, `times` those in a row without a quiet while, from 0; `seen` is the last
    change, `until` when to revert it. `reported`: a conflict was reported.
    """

    policy: str
    cpu: Cpu
    found: Cpu | None = None
    strikes: int = 0
    times: int = 0
    seen: float = -inf
    until: float = -inf
    reported: bool = False

    def give(self, policy: str, cpu: Cpu) -> None:
        """The policy's resources are in the API (again): the foreign change, if any, is over."""
        self.policy, self.cpu, self.found = policy, cpu, None

    def compare(self, spec: Cpu, now: float) -> bool:
        """Note what another client set; returns whether this is a new strike.

        Further foreign changes before we revert the first belong to the same strike.
        """
        if spec == self.found:
            return False
        struck = self.found is None
        if struck:
            self.strikes = 1 if now >= self.forgotten_at else self.strikes + 1
            self.times = 0 if now - self.seen > QUIET else self.times + 1
            self.until = now + (YIELDED if self.yielded else CONFLICTING.after(self.times))
        self.found, self.seen = spec, now
        return struck

    @property
    def yielded(self) -> bool:
        """Whether the other writer has insisted for long enough."""
        return self.strikes > STRIKES

    @property
    def left(self) -> int | None:
        """The limit that the other writer keeps, as it has insisted for long enough; None without one."""
        return self.found.limit if self.found is not None and self.yielded else None

    @property
    def rests_until(self) -> float:
        """Until when the foreign change is left in place."""
        return self.until if self.found is not None else -inf

    @property
    def forgotten_at(self) -> float:
        """When the conflict counts as over, unless it goes on; not while the foreign change is in place."""
        return inf if self.found is not None else max(self.seen, self.until) + REMEMBERED
