"""Runs a planner over time, in Rx: the one place where planning meets a clock, and the clock is an argument."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

from reactivex import Observable, Subject
from reactivex.disposable import CompositeDisposable, SerialDisposable

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Input, Score

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex.abc import DisposableBase, ObserverBase, SchedulerBase

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.planner import Planner
    from contextpolicy.policy.activities import Activity

    Taps = Mapping[str, Subject[dict[str, Any]]]
    Instantiate = Callable[..., Observable[float]]
    """A plugged-in instantiation function (paper IV-D): called with `streams`, a map from stream names to observables
    of samples' fields, `scheduler`, and the activity's `with` as keyword arguments; returns an observable of scores.

    It gets every sample as it comes: before order, age, `filter`, `debounce` and `sampleEvery`, and without features or
    `sources`; `source` is there where the stream has `sources`."""


RESTART = 1.0
"""Seconds between restarts of an instantiation function that fails: it may be slow, and fail on every sample."""


def plan_with(
    planner: Planner,
    scheduler: SchedulerBase,
    initiatives: Mapping[str, Instantiate] | None = None,
    before: Planner | None = None,
    ahead: float = 0.0,
) -> Callable[[Observable[Input]], Observable[Plan]]:
    """The Rx operator that scans inputs into plans: every new plan, from the moment of subscription on.

    Inputs must arrive on the scheduler's thread. Between inputs one timer is armed, for the planner's next deadline;
    with no deadline nothing runs. `before` is the planner of the policy's previous version, if any; `ahead` is by how
    many seconds the scheduler's time is ahead of the wall clock at the start.
    """

    def operator(inputs: Observable[Input]) -> Observable[Plan]:
        def subscribe(observer: ObserverBase[Plan], _: SchedulerBase | None = None) -> DisposableBase:
            return _Run(planner, observer, scheduler).begin(inputs, initiatives or {}, before, ahead)

        return Observable(subscribe)

    return operator


class _Run:
    """One subscription."""

    def __init__(self, planner: Planner, observer: ObserverBase[Plan], scheduler: SchedulerBase) -> None:
        self._planner, self._observer, self._scheduler = planner, observer, scheduler
        self._wake = SerialDisposable()
        self._armed = math.inf
        self._plug_ins: list[_PlugIn] = []

    def begin(
        self, inputs: Observable[Input], initiatives: Mapping[str, Instantiate], before: Planner | None, ahead: float
    ) -> DisposableBase:
        self._emit(self._planner.start(self._now(), before, ahead))
        scores = CompositeDisposable(*self._instantiate(initiatives))
        source = inputs.subscribe(self._on_input, self._observer.on_error)
        return CompositeDisposable(source, scores, self._wake)

    def _instantiate(self, initiatives: Mapping[str, Instantiate]) -> list[DisposableBase]:
        """Procedure 1, line 4: call the instantiation functions and combine their scores into the one input."""
        policy = self._planner.policy
        for task in policy.tasks:
            for index, activity in enumerate(task.activity):
                if activity.initiative is not None:
                    call = _call(activity, initiatives, self._scheduler)
                    plug_in = _PlugIn((task.name, index, activity.initiative), call, self._planner, self)
                    plug_in.start()
                    self._plug_ins.append(plug_in)
        return [plug_in.subscription for plug_in in self._plug_ins]

    def on_score(self, score: Score) -> None:
        """A plugged-in function has a new score."""
        self._take(score)

    def _take(self, event: Input) -> None:
        self._emit(self._planner.handle(event, self._now()))

    def _on_input(self, event: Input) -> None:
        # The planner first: plugged-in functions are foreign code and may be slow.
        self._take(event)
        if isinstance(event, Sample):
            for plug_in in self._plug_ins:
                plug_in.receive(event, self._now())

    def _on_wake(self, *_: object) -> None:
        """Schedulers round to microseconds and may fire early: then act as of the deadline, so that it is due."""
        armed, self._armed = self._armed, math.inf
        self._emit(self._planner.advance(max(armed, self._now())))

    def _emit(self, new: list[Plan]) -> None:
        try:
            for plan in new:
                self._observer.on_next(plan)
        finally:
            self._arm()

    def _arm(self) -> None:
        # Nearly every sample moves a deadline later. The armed timer stays: it finds nothing due then, and rearms.
        due = self._planner.next_due(self._armed)
        if due is not None and due < self._armed:
            self._armed = due
            self._wake.disposable = self._scheduler.schedule_absolute(self._scheduler.to_datetime(due), self._on_wake)

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)


def _call(
    activity: Activity, initiatives: Mapping[str, Instantiate], scheduler: SchedulerBase
) -> Callable[[Taps], Observable[float]]:
    name = str(activity.initiative)
    return lambda taps: initiatives[name](streams=dict(taps), scheduler=scheduler, **activity.arguments)


class _ScoreListener(Protocol):
    def on_score(self, score: Score) -> None:
        """A plugged-in function has a new score."""


class _PlugIn:
    """One call of an instantiation function: foreign code, whose failure must not end the stream of plans.

    After a failure its last score stays in force and the error is reported to the planner. Rx has ended the returned
    observable by then, so a later sample calls the function again; its next score clears the error.
    """

    def __init__(
        self,
        place: tuple[str, int, str],
        call: Callable[[Taps], Observable[float]],
        planner: Planner,
        listener: _ScoreListener,
    ) -> None:
        self.subscription = SerialDisposable()
        self._task, self._activity, name = place
        self._source = f"spec.tasks[{self._task}].activity[{self._activity}].initiative {name}"
        self._call, self._planner, self._listener = call, planner, listener
        self._taps: Taps = {}
        self._failed = False
        self._retry_at = 0.0
        self._arrived: float | None = None

    def start(self) -> None:
        """Call the function and subscribe to its result; new subjects cut off what an earlier call left subscribed."""
        self._failed = False
        self._taps = {stream: Subject() for stream in self._planner.streams}
        self._guard(self._subscribe)

    def receive(self, sample: Sample, now: float) -> None:
        """Pass a sample on to the function, after calling it again if it failed."""
        if self._failed and now >= self._retry_at:
            self._retry_at = now + RESTART
            self.start()
        if not self._failed and sample.stream in self._taps:
            self._arrived = sample.arrived
            fields = self._planner.streams[sample.stream].fields(sample)
            self._guard(lambda: self._taps[sample.stream].on_next(fields))
            self._arrived = None

    def _subscribe(self) -> None:
        self.subscription.disposable = self._call(self._taps).subscribe(self._on_score, self._fail)

    def _on_score(self, value: float) -> None:
        self._planner.on_expression_recovery(self._source)
        self._listener.on_score(Score(self._task, self._activity, value, self._arrived))

    def _guard(self, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as error:  # noqa: BLE001 - foreign code may raise anything
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._failed = True
        self._planner.on_expression_error(self._source, str(error) or type(error).__name__)
