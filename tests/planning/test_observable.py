"""Plans over time in Rx: exact instants in virtual time, idleness, plugged-in instantiation functions."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import pytest
import reactivex
from reactivex import Subject
from reactivex import operators as ops
from reactivex.testing import ReactiveTest, TestScheduler

from contextpolicy.planning.conditions.absence import UNHEARD
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.observable import plan_with
from contextpolicy.planning.planner import Planner
from tests.planning.builders import a_context, a_policy, a_stream, a_task, on_node, record
from tests.planning.example_initiative import steadiness
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input

MOVING = a_context("moving", "imu.speed > 0.1", tasks={"speech": {"suspend": True}}, enterAfter="250ms")


def moving_policy(**stream):
    return a_policy(
        streams=[a_stream("imu", **stream)],
        tasks=[a_task("slam", priority=3), a_task("speech")],
        contexts=[MOVING],
    )


def shares_over_time(records):
    return [(time, {name: task.share for name, task in plan.tasks.items()}) for time, plan in records]


def test_plans_come_at_exact_instants():
    inputs: dict[float, Input] = {
        2.0: on_node("slam", "speech"),
        3.0: Sample("imu", {"speed": 0.5}),
        3.5: Sample("imu", {"speed": 0.5}),
        6.0: Sample("imu", {"speed": 0.0}),
    }
    assert shares_over_time(record(moving_policy(), inputs, until=100)) == [
        (1.0, {"slam": 0, "speech": 0}),
        (2.0, {"slam": 750, "speech": 250}),
        (3.25, {"slam": 990, "speech": 10}),
        (6.0, {"slam": 750, "speech": 250}),
    ]


def test_the_plans_own_time_is_the_instant_of_its_cause():
    records = record(moving_policy(), {3.0: Sample("imu", {"speed": 0.5})}, until=100)
    assert [time for time, _ in records] == [plan.time for _, plan in records]


def due(scheduler):
    """Seconds, of all that is scheduled and was not cancelled."""
    return [scheduler.to_seconds(item.duetime) for item, _ in scheduler._queue.items if not item.is_cancelled()]


def test_only_the_unheard_timer_is_armed_when_idle():
    scheduler = TestScheduler()
    inputs: Subject[Input] = Subject()
    seen: list[Plan] = []
    inputs.pipe(plan_with(Planner(moving_policy(), Quiet(), {}), scheduler)).subscribe(seen.append)
    assert due(scheduler) == [UNHEARD]
    inputs.on_next(Sample("imu", {"speed": 0.0}))
    assert due(scheduler) == [UNHEARD]
    inputs.on_next(Sample("imu", {"speed": 1.0}))
    assert due(scheduler) == [0.25]
    scheduler.advance_to(10.0)
    assert due(scheduler) == [UNHEARD]


def test_one_timer_is_armed_however_many_samples_feed_the_watchdog():
    scheduler = TestScheduler()
    inputs: Subject[Input] = Subject()
    inputs.pipe(plan_with(Planner(moving_policy(staleAfter="1s"), Quiet(), {}), scheduler)).subscribe()
    for _ in range(100):
        inputs.on_next(Sample("imu", {"speed": 0.0}))
    assert len(scheduler._queue) == 1


def test_a_raising_observer_keeps_timers_armed():
    scheduler, inputs = TestScheduler(), Subject[Any]()
    planner = Planner(moving_policy(staleAfter="2s"), Quiet(), {})
    broken: list[Plan] = []

    def observe(plan):
        if "moving" in plan.contexts and not broken:
            broken.append(plan)
            raise KeyError("broken")

    inputs.pipe(plan_with(planner, scheduler)).subscribe(observe)
    inputs.on_next(Sample("imu", {"speed": 0.5}))
    with pytest.raises(KeyError, match="broken"):
        scheduler.advance_by(1.0)
    scheduler.stop()
    scheduler.advance_by(60.0)
    assert planner.last is not None
    assert planner.last.contexts == ()


def test_disposal_disarms_the_timer():
    scheduler = TestScheduler()
    seen: list[Plan] = []
    streams, contexts = [a_stream("imu", staleAfter="1s")], [a_context("lost")]
    policy = a_policy(streams=streams, tasks=[a_task("slam")], contexts=contexts, fallback="lost")
    planned = Subject().pipe(plan_with(Planner(policy, Quiet(), {}), scheduler))
    subscription = planned.subscribe(seen.append)
    subscription.dispose()
    scheduler.start()
    assert [plan.contexts for plan in seen] == [()]


def test_timers_continue_after_the_inputs_complete():
    policy = moving_policy(staleAfter="3s")
    scheduler = TestScheduler()
    source = scheduler.create_hot_observable(
        ReactiveTest.on_next(2, Sample("imu", {"speed": 1.0})), ReactiveTest.on_completed(3)
    )
    observer = scheduler.start(lambda: source.pipe(plan_with(Planner(policy, Quiet(), {}), scheduler)), 0.5, 1.0, 100)
    assert [message.time for message in observer.messages] == [1.0, 2.25, 5.0]


def curious_policy(**arguments):
    return a_policy(
        streams=[a_stream("imu"), a_stream("mic")],
        tasks=[a_task("slam", activity=[{"initiative": "steadiness", "with": arguments}]), a_task("rest")],
    )


class TestInitiatives:
    """Procedure 1, line 4: functions from streams to an observable of scores."""

    def scores(self, initiative, *speeds, **arguments):
        inputs = {2.0: on_node("slam", "rest")} | {
            3.0 + n: Sample("imu", {"speed": speed}) for n, speed in enumerate(speeds)
        }
        records = record(curious_policy(**arguments), inputs, until=100, initiatives={"steadiness": initiative})
        return [(time, plan.tasks["slam"].score) for time, plan in records[1:]]

    def test_the_example_scores_how_steady_the_speed_is(self):
        assert self.scores(steadiness, 1.0, 1.0, 3.0, stream="imu") == [(2.0, 0.0), (4.0, 1.0), (5.0, 1 / 3)]

    def test_it_gets_streams_scheduler_and_its_arguments(self):
        got: dict[str, Any] = {}

        def curious(*, streams, scheduler, **arguments):
            got.update(streams=sorted(streams), scheduler=scheduler, arguments=arguments)
            return reactivex.never()

        self.scores(curious, 1.0, gain="2", stream="imu")
        assert got["streams"] == ["imu", "mic"]
        assert isinstance(got["scheduler"], TestScheduler)
        assert got["arguments"] == {"gain": "2", "stream": "imu"}

    def test_it_gets_the_source_where_the_stream_keeps_its_sources_apart(self):
        got: list[Any] = []

        def curious(*, streams, scheduler):  # noqa: ARG001 - the contract's signature
            return reactivex.merge(*streams.values()).pipe(ops.do_action(got.append), ops.map(lambda _: 1.0))

        streams = [{**a_stream("lift", sources=2), "key": "lift/*"}, a_stream("imu")]
        policy = a_policy(streams=streams, tasks=[a_task("slam", activity=[{"initiative": "steadiness"}])])
        inputs: dict[float, Input] = {
            2.0: Sample("lift", {"load": 1.0}, key="lift/left"),
            3.0: Sample("lift", {"load": 2.0, "source": "me"}, key="lift/right"),
            4.0: Sample("imu", {"speed": 3.0}),
        }
        record(policy, inputs, until=100, initiatives={"steadiness": curious})
        assert got == [{"load": 1.0, "source": "left"}, {"load": 2.0, "source": "right"}, {"speed": 3.0}]

    def test_time_inside_it_is_the_schedulers(self):
        def late(*, streams, scheduler):
            return streams["imu"].pipe(ops.delay(0.5, scheduler=scheduler), ops.map(itemgetter("speed")))

        assert self.scores(late, 2.0) == [(2.0, 0.0), (3.5, 2.0)]

    def test_a_plan_that_its_score_makes_reports_when_the_sample_behind_it_arrived(self):
        """Not when it emits later, by itself."""

        def faster(speed):
            return speed + 1

        def twice(*, streams, scheduler):
            speeds = streams["imu"].pipe(ops.map(itemgetter("speed")))
            return reactivex.merge(speeds, speeds.pipe(ops.delay(0.5, scheduler=scheduler), ops.map(faster)))

        inputs: dict[float, Input] = {2.0: on_node("slam", "rest"), 3.0: Sample("imu", {"speed": 2.0}, arrived=7.0)}
        records = record(curious_policy(), inputs, until=100, initiatives={"steadiness": twice})
        assert [(time, plan.arrived) for time, plan in records[1:]] == [(2.0, None), (3.0, 7.0), (3.5, None)]


class TestFailingInitiatives:
    """A failing plug-in must not end the stream of plans; its last score stands and the error is reported."""

    SOURCE = "spec.tasks[slam].activity[0].initiative steadiness"

    def run(self, initiative, initiatives=None, planner=None):
        planner = planner or Planner(curious_policy(), Quiet(), {})
        inputs = {2.0: on_node("slam", "rest")} | {3.0 + n: Sample("imu", {"speed": 1.0 + n}) for n in range(3)}
        inputs[9.0] = on_node("slam", "rest", cores=2)
        known = {"steadiness": initiative} if initiatives is None else initiatives
        records = record(planner.policy, inputs, until=100, initiatives=known, planner=planner)
        assert records[-1][0] == 9.0
        return planner

    def test_while_running(self):
        def only_1(sample):
            return {1.0: 1.0}[sample["speed"]]

        def breaks_from_2_on(*, streams, scheduler):  # noqa: ARG001 - the contract's signature
            return streams["imu"].pipe(ops.map(only_1))

        planner = self.run(breaks_from_2_on)
        assert planner.errors == {self.SOURCE: "3.0"}
        assert planner.scores()["slam"] == 1.0

    def test_failure_and_recovery_are_reported(self):
        """Rx ends what has failed once: the function is called again."""

        def not_2(sample):
            return sample["speed"] / (2.0 - sample["speed"]) ** 2

        def breaks_at_2(*, streams, scheduler):  # noqa: ARG001 - the contract's signature
            return streams["imu"].pipe(ops.map(not_2))

        health = []

        class Listener:
            def on_health(self):
                health.append(dict(planner.errors))

        planner = Planner(curious_policy(), Listener(), {})
        assert self.run(breaks_at_2, planner=planner).errors == {}
        reported = [errors for errors, _ in groupby(health)]
        assert reported[reported.index({self.SOURCE: "float division by zero"}) :] == [
            {self.SOURCE: "float division by zero"},
            {},
        ]
        assert planner.scores()["slam"] == 3.0

    def test_one_that_fails_at_each_sample_is_called_again_once_a_second(self):
        calls, scheduler = [], TestScheduler()
        inputs: Subject[Input] = Subject()

        def unwilling(**_):
            calls.append(scheduler.clock)
            raise RuntimeError("no camera")

        inputs.pipe(plan_with(Planner(curious_policy(), Quiet(), {}), scheduler, {"steadiness": unwilling})).subscribe()
        for _ in range(30):
            scheduler.advance_by(0.1)
            inputs.on_next(Sample("imu", {"speed": 1.0}))
        assert calls == pytest.approx([0.0, 0.1, 1.1, 2.1])

    def test_leftover_observers_of_a_failed_function_are_disposed(self):
        heard: list[list[dict[str, float]]] = []

        def leaves_an_observer(*, streams, scheduler):  # noqa: ARG001 - the contract's signature
            generation = len(heard)
            heard.append([])
            streams["imu"].subscribe(heard[generation].append)
            return streams["imu"].pipe(ops.map(itemgetter("missing")))

        self.run(leaves_an_observer)
        assert [[sample["speed"] for sample in one] for one in heard] == [[1.0], [2.0], [3.0]]

    def test_when_called(self):
        def unwilling(**_):
            raise RuntimeError("no camera")

        assert self.run(unwilling).errors == {self.SOURCE: "no camera"}

    def test_when_it_returns_no_observable(self):
        assert list(self.run(lambda **_: 1.0).errors) == [self.SOURCE]

    def test_when_it_is_not_there(self):
        assert list(self.run(None, {}).errors) == [self.SOURCE]

    def test_when_its_own_observer_raises(self):
        """Not through Rx's error channel, but straight out of `on_next`."""

        def rude(*, streams, scheduler):  # noqa: ARG001 - the contract's signature
            def subscribe(_observer, _scheduler=None):
                def fail(_sample):
                    raise RuntimeError("rude")

                return streams["imu"].subscribe(fail)

            return reactivex.create(subscribe)

        assert self.run(rude).errors == {self.SOURCE: "rude"}
