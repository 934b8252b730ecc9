"""One policy with other numbers in it, tried on timelines: what `suggest` does many times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.forecast import forecast
from contextpolicy.simulation.knobs import turned
from contextpolicy.simulation.run import simulate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.forecast import Forecast
    from contextpolicy.simulation.knobs import Values
    from contextpolicy.simulation.profiles import Profiles
    from contextpolicy.simulation.robot import Robot
    from contextpolicy.streams.timeline import Timeline


@dataclass(frozen=True, slots=True)
class Trial:
    """A policy as it is written (`resource`) and as it was understood, with all that a prediction needs."""

    resource: Mapping[str, Any]
    policy: Policy
    timelines: Sequence[Timeline]
    profiles: Profiles
    robot: Robot
    initiatives: Mapping[str, Instantiate]
    deadlines: Mapping[str, float]
    """Seconds, of tasks whose deadline was overridden on the command line."""

    def predict(self, values: Values) -> list[Forecast] | None:
        """A forecast for each timeline; None for a policy that would be refused."""
        try:
            parsed = parse(turned(self.resource, values))
        except PolicyError:
            return None
        # No knob is in a stream, and streams know message types that are not in the resource.
        policy = replace(parsed, streams=self.policy.streams)
        return [self._forecast(policy, timeline) for timeline in self.timelines]

    def _forecast(self, policy: Policy, timeline: Timeline) -> Forecast:
        run = simulate(policy, timeline, robot=self.robot, initiatives=self.initiatives)
        return forecast(
            policy,
            timeline,
            run.plans,
            self.profiles,
            until=timeline.duration,
            deadlines=self.deadlines,
        )


def demand(forecasts: Sequence[Forecast], timelines: Sequence[Timeline]) -> dict[str, float]:
    """The most cores that each task needs over a whole timeline, without what is suspended."""
    needs: dict[str, float] = {}
    for predicted, timeline in zip(forecasts, timelines, strict=True):
        for task, outcomes in predicted.outcomes.items():
            own = sum(one.work.cpu for one in outcomes) / timeline.duration
            needs[task] = max(needs.get(task, 0.0), own)
    return {task: need for task, need in needs.items() if need > 0}
