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
    from contextpolicy.policy.spec import Activity

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
        self._plug_ins: list[_PlugIn] = []

    def begin(
        self, inputs: Observable[Input], initiatives: Mapping[str, Instantiate], before: Planner | None
    ) -> DisposableBase:
        self._emit(self._planner.start(self._now(), before))
        scores = CompositeDisposable(*self._instantiate(initiatives))
        source = inputs.subscribe(self._on_input, self._observer.on_error, scheduler=self._scheduler)
        return CompositeDisposable(source, scores, self._wake)

    def _instantiate(self, initiatives: Mapping[str, Instantiate]) -> list[DisposableBase]:
        """Procedure 1, line 4: call the instantiation functions and combine their scores into the one input."""
        policy = self._planner.policy
        for task in policy.tasks:
            for index, activity in enumerate(task.activity):
                if activity.initiative is not None:
                    streams = [stream.name for stream in policy.streams]
                    plug_in = _PlugIn(activity, streams, self._on_score(task.name, index), self._planner)
                    plug_in.start(initiatives, self._scheduler)
                    self._plug_ins.append(plug_in)
        return [plug_in.subscription for plug_in in self._plug_ins]

    def _on_score(self, task: str, index: int) -> Callable[[float], None]:
        return lambda value: self._emit(self._planner.handle(Score(task, index, value), self._now()))

    def _on_input(self, event: Input) -> None:
        self._emit(self._planner.handle(event, self._now()))
        if isinstance(event, Sample):
            for plug_in in self._plug_ins:
                plug_in.tell(event)

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


class _PlugIn:
    """One call of an instantiation function: foreign code, whose failure must not end the stream of plans.

    After a failure its last score stands and `planner.errors` tells.
    """

    def __init__(
        self, activity: Activity, streams: list[str], on_score: Callable[[float], None], planner: Planner
    ) -> None:
        self.subscription = SerialDisposable()
        self._activity, self._on_score, self._planner = activity, on_score, planner
        self._name = str(activity.initiative)
        self._taps: dict[str, Subject[dict[str, Any]]] = {stream: Subject() for stream in streams}

    def start(self, initiatives: Mapping[str, Instantiate], scheduler: SchedulerBase) -> None:
        """Call the function and listen to what it returns."""

        def subscribe() -> None:
            instantiate = initiatives[self._name]
            scores = instantiate(streams=dict(self._taps), scheduler=scheduler, **self._activity.arguments)
            self.subscription.disposable = scores.subscribe(self._on_score, self._note)

        self._guard(subscribe)

    def tell(self, sample: Sample) -> None:
        """Hand a sample on."""
        tap = self._taps.get(sample.stream)
        if tap is not None:
            self._guard(lambda: tap.on_next(sample.value))

    def _guard(self, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as error:  # noqa: BLE001 - nobody knows what foreign code raises
            self._note(error)

    def _note(self, error: Exception) -> None:
        self._planner.errors[f"initiative {self._name}"] = str(error)
