"""A planner over time, in Rx: the one place where planning meets a clock, and the clock is an argument."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reactivex import Observable, Subject
from reactivex.disposable import CompositeDisposable, SerialDisposable

from contextpolicy.planning.inputs import Input, Score
from contextpolicy.planning.sample import Sample

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.plan import Plan
    from contextpolicy.planning.planner import Planner

    Instantiate = Callable[..., Observable[float]]
    """A plugged-in instantiation function (paper IV-D): called with `streams`, a map from stream names to observables
    of samples' fields, `scheduler`, and the activity's `with` as keyword arguments; returns an observable of scores."""


def plans(
    planner: Planner,
    inputs: Observable[Input],
    scheduler: SchedulerBase,
    initiatives: Mapping[str, Instantiate] | None = None,
    before: Planner | None = None,
) -> Observable[Plan]:
    """Every new plan, from the moment of subscription on.

    Inputs must arrive on the scheduler's thread. Between inputs one timer is armed, for the planner's next deadline;
    with no deadline nothing runs. `before` is the planner of the policy's last version, if it had one.
    """

    def subscribe(observer: ObserverBase[Plan], _: SchedulerBase | None = None) -> DisposableBase:
        return _Run(planner, observer, scheduler).begin(inputs, initiatives or {}, before)

    return Observable(subscribe)


class _Run:
    """One subscription."""

    def __init__(self, planner: Planner, observer: ObserverBase[Plan], scheduler: SchedulerBase) -> None:
        self._planner, self._observer, self._scheduler = planner, observer, scheduler
        self._wake = SerialDisposable()
        self._armed: float | None = None
        self._taps: dict[str, Subject[dict[str, Any]]] = {}

    def begin(
        self, inputs: Observable[Input], initiatives: Mapping[str, Instantiate], before: Planner | None
    ) -> DisposableBase:
        self._emit(self._planner.start(self._now(), before))
        scores = CompositeDisposable(*self._instantiate(initiatives))
        source = inputs.subscribe(self._on_input, self._observer.on_error, scheduler=self._scheduler)
        return CompositeDisposable(source, scores, self._wake)

    def _instantiate(self, initiatives: Mapping[str, Instantiate]) -> list[DisposableBase]:
        """Procedure 1, line 4: call the instantiation functions and combine their scores into the one input."""
        subscriptions: list[DisposableBase] = []
        for task in self._planner.policy.tasks:
            for index, activity in enumerate(task.activity):
                if activity.initiative is None:
                    continue
                if not self._taps:
                    self._taps = {stream.name: Subject() for stream in self._planner.policy.streams}
                scores = initiatives[activity.initiative](
                    streams=dict(self._taps), scheduler=self._scheduler, **activity.arguments
                )
                subscriptions.append(
                    scores.subscribe(self._on_score(task.name, index), self._on_failure(activity.initiative))
                )
        return subscriptions

    def _on_score(self, task: str, index: int) -> Callable[[float], None]:
        return lambda value: self._on_input(Score(task, index, value))

    def _on_failure(self, name: str) -> Callable[[Exception], None]:
        """A plug-in that fails must not end the stream of plans: its last score stands and the error is told."""

        def note(error: Exception) -> None:
            self._planner.errors[f"initiative {name}"] = str(error)

        return note

    def _on_input(self, event: Input) -> None:
        self._emit(self._planner.handle(event, self._now()))
        if self._taps and isinstance(event, Sample) and event.stream in self._taps:
            self._taps[event.stream].on_next(event.value)

    def _on_wake(self, *_: object) -> None:
        """Schedulers round to microseconds: the deadline itself is never before `now`."""
        armed, self._armed = self._armed or 0.0, None
        self._emit(self._planner.advance(max(armed, self._now())))

    def _emit(self, new: list[Plan]) -> None:
        for plan in new:
            self._observer.on_next(plan)
        due = self._planner.next_due()
        if due is not None and (self._armed is None or due < self._armed):
            self._armed = due
            self._wake.disposable = self._scheduler.schedule_absolute(self._scheduler.to_datetime(due), self._on_wake)

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)
