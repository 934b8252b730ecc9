"""What the tasks have to share: so many processors, slowed to a part of a whole one's speed. Pure.

A task of one thread can't be given more than one processor. So a load of 1.4 needs few and fast processors rather than
many slow ones, on which the heaviest task would fail alone. All else may run on the other processors as well.
"""

from __future__ import annotations

from typing import NamedTuple

from contextpolicy.policy.quantities import format_cpu

STEP = 10
"""Thousandths of a core, in which a policy divides."""
KUBERNETES = 200
"""Thousandths of a core for Kubernetes and the operator, where they run on the same processors."""


WHOLE = 430_000.0
"""What counts as a whole processor, in turns a second of the loop in `thief`, by Python 3.11: a little less than a
thread of an EPYC at 2.4 GHz does while another one keeps the same core busy, and half of what it does without. Tasks
do not get faster as the loop does: on a machine 1.5 times as fast they took 1.26 times as many turns for the same
inputs. So a load holds only near the speed at which it was calibrated."""


class Capacity(NamedTuple):
    """`processors` for the tasks, and the `part` of a whole one that each of them does (see `slowed`)."""

    processors: int
    part: float

    @property
    def pace(self) -> float:
        """What each processor does, in turns a second."""
        return self.part * WHOLE

    def __str__(self) -> str:
        return f"{self.processors} x {self.part:g}"

    @property
    def name(self) -> str:
        """For folders."""
        return f"{self.processors}x{self.part:g}"

    def reserve(self, cores: int) -> str:
        """What a policy must not divide on a node with so many cores: CPU that the tasks can't have."""
        there = self.processors * self.part * 1000
        beside = KUBERNETES * self.part if self.processors == cores else 0.0
        return format_cpu(cores * 1000 - int((there - beside) // STEP * STEP))
