"""What the tasks have to share: so many processors, slowed to a part of a whole one's speed. Pure.

A task of one thread can't be given more than one processor. So a load of 1.4 needs few and fast processors rather than
many slow ones, on which the heaviest task would fail alone. All else may run on the other processors as well.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.policy.quantities import format_cpu, parse_cpu

if TYPE_CHECKING:
    from collections.abc import Mapping

STEP = 10
"""Thousandths of a core, in which a policy divides."""
BESIDE = 700
"""Thousandths of a whole processor for all that runs beside the tasks where it has to share their processors: kubelet,
API server, containerd, router, operator, and what plays and records (0.68, the median of ten runs on two)."""

WHOLE = 430_000.0
"""What counts as a whole processor, in turns a second of the loop in `thief`, by Python 3.11, on the machine where it
was first measured what the tasks want: a little less than a thread of an EPYC at 2.4 GHz does while another one keeps
the same core busy. On others it is as many as the tasks take there for the same inputs (see `machine`)."""


class Capacity(NamedTuple):
    """`processors` for the tasks, and the `part` of a whole one that each of them does (see `slowed`)."""

    processors: int
    part: float

    def __str__(self) -> str:
        return f"{self.processors} x {self.part:g}"

    @property
    def name(self) -> str:
        """For folders."""
        return f"{self.processors}x{self.part:g}"

    def reserve(self, cores: int, speed: float) -> str:
        """What a policy must not divide on a node with so many cores: CPU time that the tasks can't have.

        `speed` is what a processor does, in whole ones.
        """
        there = self.processors * self.part * 1000 - beside(self.processors, cores)
        return format_cpu(max(0, cores * 1000 - int(there / speed // STEP * STEP)))


def beside(processors: int, cores: int) -> int:
    """Thousandths of a whole processor that all else takes of so many processors: none where it has others."""
    return BESIDE if processors == cores else 0


def in_cpu_time(policy: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """A policy whose bounds, written in whole processors, are CPU time of processors that do so many whole ones."""
    changed = copy.deepcopy(dict(policy))
    for task in changed["spec"]["tasks"]:
        task |= {bound: format_cpu(round(parse_cpu(task[bound]) / speed)) for bound in ("min", "max") if bound in task}
    return changed
