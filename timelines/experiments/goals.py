"""What has to be reached. Declared before the runs. Pure.

Three measures changed after the first heavy block: docs/measurements/paper-experiments.md says which.

Each goal compares a configuration with another one of the same block, case by case: a context's critical task, or a
task. It holds if it holds in every case (an intersection-union test: the least sure case decides, and needs no
correction for the number of cases). Among the goals Holm's correction applies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from timelines.experiments.blocks import HEAVY, LIGHT
from timelines.experiments.configurations import ALONE, LINUX, STATIC, STATIC_GATED, WEIGHTS, WEIGHTS_GATED
from timelines.experiments.metrics import NEVER

if TYPE_CHECKING:
    from collections.abc import Sequence

POINT = 0.01
SIGNIFICANT = 0.05
"""What Holm's corrected probability may be at most."""


@dataclass(frozen=True, slots=True)
class Goal:
    """`metric` of the configuration is at least (or at most) `factor` times that of `against`, plus `offset`.

    `metric` is a name in `metrics.METRICS`; `offset` is in its unit: a rate from 0 to 1, or seconds. `worst` is as bad
    as a value can be: a bound beyond it would be kept by what was never done.
    """

    name: str
    load: str
    configuration: str
    against: str
    metric: str
    factor: float = 1.0
    offset: float = 0.0
    at_least: bool = True
    worst: float = math.inf

    def gain(self, value: float, base: float) -> float:
        """By how much the value is better than it has to be."""
        bound = min(self.factor * base + self.offset, self.worst)
        return value - bound if self.at_least else bound - value


GOALS: Sequence[Goal] = (
    Goal(
        "each context's critical task keeps its solo hit rate, less 2 points (gated)",
        *(HEAVY, WEIGHTS_GATED.name, ALONE.name, "critical hit rate"),
        offset=-2 * POINT,
    ),
    Goal(
        "each context's critical task keeps its solo hit rate, less 2 points (nothing suspended)",
        *(HEAVY, WEIGHTS.name, ALONE.name, "critical hit rate"),
        offset=-2 * POINT,
    ),
    Goal(
        "each critical or protected task that is judged is as accurate as alone, less 2 points",
        *(HEAVY, WEIGHTS_GATED.name, ALONE.name, "accuracy"),
        offset=-2 * POINT,
    ),
    Goal(
        "each critical or protected task covers as much as alone, less 2 points",
        *(HEAVY, WEIGHTS_GATED.name, ALONE.name, "coverage"),
        offset=-2 * POINT,
    ),
    Goal(
        "the same input takes at most 1.03 times the CPU",
        *(HEAVY, WEIGHTS_GATED.name, LINUX.name, "CPU per same input"),
        factor=1.03,
        at_least=False,
    ),
    Goal(
        "the worst context hits at least 5 points more than under tuned static weights (gated)",
        *(HEAVY, WEIGHTS_GATED.name, STATIC_GATED.name, "worst context"),
        offset=5 * POINT,
    ),
    Goal(
        "the worst context hits at least 5 points more than under tuned static weights (nothing suspended)",
        *(HEAVY, WEIGHTS.name, STATIC.name, "worst context"),
        offset=5 * POINT,
    ),
    Goal(
        "first law: the hit rate of no task that runs drops by more than a point",
        *(LIGHT, WEIGHTS_GATED.name, LINUX.name, "hit rate"),
        offset=-POINT,
    ),
    Goal(
        "first law: the hit rate of no task drops by more than a point (nothing suspended)",
        *(LIGHT, WEIGHTS.name, LINUX.name, "hit rate"),
        offset=-POINT,
    ),
    Goal(
        "first law: the p99 of no task (p90 of fewer than 100 inputs) grows by more than 20 % plus 5 ms",
        *(LIGHT, WEIGHTS_GATED.name, LINUX.name, "tail"),
        factor=1.2,
        offset=0.005,
        at_least=False,
        worst=NEVER,
    ),
)
SPEEDUP = 1.42
"""The paper's own figure, at most (its section VI-B): reported beside ours on its first experiment, under its terms."""
