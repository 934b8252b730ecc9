"""The run itself: inputs one by one on a virtual clock, every plan as it falls."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from reactivex import Observable
from reactivex.disposable import MultipleAssignmentDisposable
from reactivex.scheduler import HistoricalScheduler

from contextpolicy.planning.observable import plans
from contextpolicy.planning.placement import on_one_node
from contextpolicy.planning.planner import Planner
from contextpolicy.simulation.samples import EPOCH, Skipped, samples

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.planning.plan import Plan
    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.timeline import Timeline


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
    begin = datetime.fromtimestamp(EPOCH, UTC)
    scheduler = HistoricalScheduler(begin)
    placement = on_one_node(tuple(task.name for task in policy.leaves), cores)
    timed = _inputs(scheduler, placement, samples(policy, timeline.inputs(), run.skipped, run.planner.drops))
    plans(run.planner, timed, scheduler, initiatives).subscribe(run.plans.append)
    scheduler.advance_to(begin + timedelta(seconds=run.until))
    # A policy without watchdogs plans before it is told of its containers, for nobody.
    run.plans = [replace(plan, time=round(plan.time - EPOCH, 6)) for plan in run.plans if plan.nodes]
    return run


def _inputs(scheduler: SchedulerBase, first: Input, later: Iterator[tuple[float, Input]]) -> Observable[Input]:
    """Inputs at their times, each scheduled when the one before has acted: a long timeline is never in memory."""

    def subscribe(observer: ObserverBase[Input], _: SchedulerBase | None = None) -> DisposableBase:
        waiting = MultipleAssignmentDisposable()

        def schedule_next() -> None:
            following = next(later, None)
            if following is not None:
                at, event = following
                waiting.disposable = scheduler.schedule_absolute(scheduler.to_datetime(EPOCH + at), act, event)

        def act(_: SchedulerBase, event: Any = None) -> None:
            observer.on_next(event)
            schedule_next()

        observer.on_next(first)
        schedule_next()
        return waiting

    return Observable(subscribe)
