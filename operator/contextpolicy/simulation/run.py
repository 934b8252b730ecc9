"""The run itself: feeds inputs one by one on a virtual clock and collects every plan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from reactivex import Subject
from reactivex.scheduler import HistoricalScheduler

from contextpolicy.planning.observable import plan_with
from contextpolicy.simulation.epoch import epoch_of
from contextpolicy.simulation.noting_planner import NotingPlanner
from contextpolicy.simulation.samples import Skipped, samples

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.robot import Robot
    from contextpolicy.streams.timeline import Timeline


MICROSECOND = timedelta(microseconds=1)
"""The resolution of Rx's clocks."""
PROGRESS = 4096
"""Samples between two progress reports: about a tenth of a second."""


@dataclass(slots=True)
class Simulation:
    """The result of a run. Times of plans count from the start of the timeline; the planner has Unix times."""

    planner: NotingPlanner
    until: float
    epoch: float
    plans: list[Plan] = field(default_factory=list)
    skipped: Skipped = field(default_factory=Skipped)


def simulate(  # noqa: PLR0913 - what a run may be given, by keyword
    policy: Policy,
    timeline: Timeline,
    *,
    robot: Robot,
    until: float | None = None,
    initiatives: Mapping[str, Instantiate] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Run the timeline to its end, or up to and including `until` seconds.

    `on_progress` gets the virtual time every `PROGRESS` samples.
    """
    epoch = epoch_of(policy, timeline)
    run = Simulation(NotingPlanner(policy), timeline.duration if until is None else until, epoch)
    clock = _Clock(epoch)
    inputs: Subject[Input] = Subject()
    inputs.pipe(plan_with(run.planner, clock, initiatives)).subscribe(run.plans.append)
    inputs.on_next(robot.placement(policy))
    timed = samples(policy, timeline.inputs(), run.skipped, run.planner.drops, epoch)
    for count, (at, sample) in enumerate(timed):
        if at > run.until:
            break
        if on_progress is not None and count % PROGRESS == 0:
            on_progress(at)
        clock.advance_before(at)
        inputs.on_next(sample)
    clock.finish(run.until)
    # A policy without watchdogs makes a plan before it knows of any container: that one applies to nothing.
    run.plans = [replace(plan, time=round(plan.time - epoch, 6)) for plan in run.plans if plan.nodes]
    return run


class _Clock(HistoricalScheduler):
    """Virtual time driven by the inputs, which are fed directly: only timers are scheduled.

    Scheduling each input as well took a quarter of a run with a sensor of 1 kHz.
    """

    def __init__(self, epoch: float) -> None:
        self._begin = datetime.fromtimestamp(epoch, UTC)
        super().__init__(self._begin)

    def advance_before(self, at: float) -> None:
        """Set the time to `at` after firing all earlier timers; the planner orders those due at `at` itself."""
        moment = self._begin + timedelta(seconds=at)
        if self._queue and self._queue.peek().duetime < moment:
            self.advance_to(moment - MICROSECOND)
        self._clock = moment

    def finish(self, at: float) -> None:
        """Fire every timer due up to and including `at`."""
        moment = self._begin + timedelta(seconds=at)
        # A last input at `moment` left timers due then unfired, and `advance_to` does nothing if the time is the same.
        self._clock = min(self.now, moment - MICROSECOND)
        self.advance_to(moment)
