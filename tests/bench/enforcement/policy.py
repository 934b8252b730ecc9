"""The weights that a policy would have for this robot, and what else was tried. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from contextpolicy.agent.drains import DRAIN
from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT
from tests.bench.enforcement.stories import PROCESSORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.bench.enforcement.stories import Context, Task

STEP = 10
"""Thousandths of a core: shares move in these steps, and a suspended task keeps one."""


@dataclass(frozen=True, slots=True)
class Table:
    """A policy's weights: of the critical task, of all others, and what a protected one has whatever happens.

    `floor` is its min and `least` the least weight that it is given, both in thousandths of a core. `needs`: nobody has
    less than it wants, where all of that fits. `slice` are the protected tasks'. `above` is the load below which nobody
    is weighted. `freeze`: a suspended task has a quota, which also stops the input that it is at; `grace` are the
    seconds for which it has only the least weight before.
    """

    critical: float = 100
    other: float = 3
    floor: int = 100
    least: int = 0
    needs: bool = False
    slice: float | None = None
    above: float = 0.0
    freeze: bool = True
    grace: float = 0.0

    def weight(self, task: Task, context: Context) -> float:
        """The task's weight in a context; 0 is suspended."""
        if task.name in context.suspends:
            return 0
        if task.name == context.critical:
            return self.critical
        return PROTECTED.get(task.name, self.other)

    def floors(self, running: Sequence[Task]) -> dict[str, int]:
        """What each running task has at least, in thousandths of a core."""
        floors = {task.name: self.floor if task.protected else STEP for task in running}
        if self.needs and sum(task.wants for task in running) <= PROCESSORS:
            return {task.name: max(floors[task.name], round(task.wants * 1000)) for task in running}
        return floors


PROTECTED = {"nav": 10.0, "imu": 5.0}
TABLE = Table()
WEIGHTED = Table(least=PROTECTED_WEIGHT, grace=DRAIN)
"""As the agent enforces weights; the attempts below are why it does so."""
ATTEMPTS = {
    "weights, floor 100m, quota at once": TABLE,
    "weights, ratio 10": Table(critical=30),
    "weights, quota at once": replace(WEIGHTED, grace=0.0),
    "weights, protected 300m": replace(WEIGHTED, least=300),
    "weights, protected 500m": replace(WEIGHTED, least=500),
    "weights, protected 1000m": replace(WEIGHTED, least=1000),
    "weights, protected 2000m": replace(WEIGHTED, least=2000),
    "weights, slice 0.5 ms": replace(WEIGHTED, slice=0.0005),
    "weights, floors at need": replace(WEIGHTED, needs=True),
    "weights, only above 0.8": replace(WEIGHTED, above=0.8),
    "weights, no quota": replace(WEIGHTED, freeze=False, grace=0.0),
}
"""What else was tried for the goals."""
