"""What `contextpolicy simulate --profiles` says of the held-out stories, before they are played. Experimental.

The profiles are of a tuning story in which each task ran alone: of other runs than those that are predicted.
Predictions are frozen with what was calibrated, and the report scores them against always answering 0 %, and as under
Linux default.
"""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.forecast import forecast
from contextpolicy.simulation.profiles import Profiles
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.simulation.server import Fate
from timelines.experiments.capacity import in_cpu_time
from timelines.experiments.configurations import LIMITS, LIMITS_GATED, WEIGHTS, WEIGHTS_GATED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.simulation.server import Outcome
    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.capacity import Capacity
    from timelines.experiments.configurations import Configuration
    from timelines.experiments.due import Schedule

PREDICTED: Sequence[Configuration] = (WEIGHTS, WEIGHTS_GATED, LIMITS, LIMITS_GATED)
REACTION = 0.0036
"""Seconds from a plan to eight cgroups with the node agent, which all of these have (`make bench-reaction`)."""
TAIL = 5.0
"""Seconds after the story until which queues are followed."""


def slowed_down(profiles: Profiles, part: float) -> Profiles:
    """What inputs cost where only this part of each processor is left: longer, since nobody can be given more of it."""
    return Profiles(
        {
            name: replace(
                own,
                background=own.background / part,
                inputs=tuple(
                    replace(cost, quantiles=tuple(one / part for one in cost.quantiles)) for cost in own.inputs
                ),
            )
            for name, own in profiles.tasks.items()
        }
    )


def predict(
    policy: Mapping[str, Any], timeline: Timeline, due: Schedule, profiles: Profiles, capacity: Capacity
) -> dict[str, dict[str, float]]:
    """The part of what contexts want of each task that is missed, by configuration: what the runs are counted by.

    `profiles` are of processors as slow as these.
    """
    until = timeline.duration + TAIL
    slowed = in_cpu_time(policy, capacity.part)
    found = {}
    for one in PREDICTED:
        resource = one.variant(slowed, "0")
        if resource is None:  # nothing is decided
            continue
        variant = parse(resource)
        plans = simulate(variant, timeline, robot=Robot({NODE: capacity.processors * 1000}), until=until).plans
        outcomes = forecast(variant, timeline, plans, profiles, until=until, reaction=REACTION).outcomes
        wanted = {task: [end for end in own if _is_wanted(end, due)] for task, own in outcomes.items()}
        found[one.name] = {
            task: round(fmean(_is_missed(end, due) for end in own), 4) for task, own in wanted.items() if own
        }
    return found


def _is_wanted(end: Outcome, due: Schedule) -> bool:
    return due.wants(end.work.task, end.work.at - end.work.transit)


def _is_missed(end: Outcome, due: Schedule) -> bool:
    return end.fate is not Fate.DONE or end.response > due.deadlines.get(end.work.task, math.inf)
