"""The run itself: inputs one by one on a virtual clock, every plan as it falls."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from reactivex import Subject
from reactivex.scheduler import HistoricalScheduler

from contextpolicy.planning.observable import plans
from contextpolicy.planning.placement import on_one_node
from contextpolicy.planning.planner import Planner
from contextpolicy.simulation.samples import EPOCH, Skipped, samples

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.planning.plan import Plan
    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.timeline import Timeline


MICROSECOND = timedelta(microseconds=1)
"""The step of Rx's clocks."""


@dataclass(slots=True)
class Simulation:
    """What a run left behind. Plans have times from the start of the timeline, the planner has Unix times."""

    planner: Planner
    until: float
    plans: list[Plan] = field(default_factory=list)
    skipped: Skipped = field(default_factory=Skipped)


def simulate(
    policy: Policy,
    timeline: Timeline,
    *,
    cores: float,
    until: float | None = None,
    initiatives: Mapping[str, Instantiate] | None = None,
) -> Simulation:
    """Run the timeline to its end, or up to and including `until` seconds. A forced context holds throughout."""
    run = Simulation(Planner(policy), timeline.duration if until is None else until)
    clock = _Clock(EPOCH)
    inputs: Subject[Input] = Subject()
    plans(run.planner, inputs, clock, initiatives).subscribe(run.plans.append)
    inputs.on_next(on_one_node(tuple(task.name for task in policy.leaves), cores))
    for at, sample in samples(policy, timeline.inputs(), run.skipped, run.planner.drops):
        if at > run.until:
            break
        clock.advance_before(at)
        inputs.on_next(sample)
    clock.finish(run.until)
    # A policy without watchdogs plans before it is told of its containers, for nobody.
    run.plans = [replace(plan, time=round(plan.time - EPOCH, 6)) for plan in run.plans if plan.nodes]
    return run


class _Clock(HistoricalScheduler):
    """Virtual time that inputs drive: they come by themselves, only timers are scheduled.

    Scheduling each input as well took a quarter of a run with a sensor of 1 kHz.
    """

    def __init__(self, epoch: float) -> None:
        self._begin = datetime.fromtimestamp(epoch, UTC)
        super().__init__(self._begin)

    def advance_before(self, at: float) -> None:
        """Let `at` be now, with all timers of earlier moments fired: one due at `at` is the planner's to order."""
        moment = self._begin + timedelta(seconds=at)
        if self._queue and self._queue.peek().duetime < moment:
            self.advance_to(moment - MICROSECOND)
        self._clock = moment

    def finish(self, at: float) -> None:
        """Let everything due up to and including `at` act."""
        moment = self._begin + timedelta(seconds=at)
        self._clock = min(self.now, moment - MICROSECOND)  # a last input at `moment` left its timers standing
        self.advance_to(moment)
