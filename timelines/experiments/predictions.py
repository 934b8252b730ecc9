"""What `contextpolicy simulate --profiles` says of the held-out stories, before they are played. Experimental.

The profiles are of a tuning story in which each task ran alone: of other runs than those that are predicted.
Predictions are frozen with what was calibrated, and the report scores them against always answering 0 %, and as under
Linux default.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.forecast import ALL, forecast
from contextpolicy.simulation.profiles import Profiles, parse_profiles
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from timelines.experiments.capacity import in_cpu_time
from timelines.experiments.configurations import LIMITS, LIMITS_GATED, WEIGHTS, WEIGHTS_GATED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.capacity import Capacity
    from timelines.experiments.configurations import Configuration

PREDICTED: Sequence[Configuration] = (WEIGHTS, WEIGHTS_GATED, LIMITS, LIMITS_GATED)
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
    policy: Mapping[str, Any], timeline: Timeline, measured: Mapping[str, Any], capacity: Capacity, speed: float = 1.0
) -> dict[str, dict[str, float]]:
    """The part of each task's inputs that is late or dropped, by configuration.

    `measured` is a file of profiles, whose CPU time is of processors that did so many whole ones (`speed`).
    """
    profiles, until = slowed_down(parse_profiles(measured), capacity.part / speed), timeline.duration + TAIL
    slowed = in_cpu_time(policy, capacity.part)
    found = {}
    for one in PREDICTED:
        resource = one.variant(slowed, "0")
        if resource is None:  # nothing is decided
            continue
        variant = parse(resource)
        plans = simulate(variant, timeline, robot=Robot({NODE: capacity.processors * 1000}), until=until).plans
        tasks = forecast(variant, timeline, plans, profiles, until=until).tasks
        found[one.name] = {name: round(own[ALL].misses, 4) for name, own in tasks.items() if ALL in own}
    return found
