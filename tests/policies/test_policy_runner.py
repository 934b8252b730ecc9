"""One running policy: what it orders and publishes, and what it hands over to its next version."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
from prometheus_client import REGISTRY

from contextpolicy.bus import head_start
from contextpolicy.policies import plan_publisher
from tests.cluster.builders import NODE
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.runner_rig import APPLIED, IMU, PLAN, Robot
from tests.virtual_operator import START


def test_nothing_is_ordered_before_the_containers_nodes_are_known():
    robot = Robot()
    robot.runner.start()
    assert robot.runner.planner.last is not None
    assert (robot.orders.all, robot.session.published) == ([], [])


def test_a_plan_becomes_an_order_and_a_message():
    robot = Robot().begin()
    robot.sample(speed=0.3)
    order = robot.orders.last
    assert order.policy == "lab/robot"
    assert order.claimed == {"lab/slam/slam", "lab/speech/speech"}
    assert order.shares == {"lab/slam/slam": 800, "lab/speech/speech": 200}
    assert order.capacity == {NODE: 1000}
    message = robot.session.plans()[-1]
    assert (message["contexts"], message["edition"]) == (["moving"], 0)
    assert message["trigger"] == pytest.approx(START, abs=1.0)


def with_agent(**spec):
    robot = Robot(**spec)
    robot.session.agents[NODE] = b'{"missing": {"CFS": [], "Realtime": []}}'
    robot.begin()
    robot.loop.advance_by(1.0)
    return robot


def test_what_its_agent_runs_in_realtime_is_not_claimed():
    robot = with_agent(enforcement={"scheduler": "Realtime"})
    assert (robot.orders.last.claimed, robot.orders.last.shares) == (frozenset(), {})


def test_orders_wait_for_the_agents_head_start():
    robot = with_agent()
    orders, messages = len(robot.orders.all), len(robot.session.plans())
    robot.plans.clear()
    robot.session.deliver(IMU, speed=0.3)
    robot.loop.advance_by(0.001)
    assert (len(robot.session.plans()), len(robot.orders.all), robot.plans) == (messages + 1, orders, [])
    robot.loop.advance_by(head_start.SECONDS)
    assert len(robot.orders.all) == orders + 1
    assert [plan.contexts for _, plan in robot.plans] == [("moving",)]


def test_a_context_that_begins_meanwhile_does_not_end():
    moving = a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}})
    robot = with_agent(contexts=[moving, a_context("dark", "imu.light < 5.0", {})], enforcement={"minDwell": "100ms"})
    for light in (9.0, 1.0):
        robot.session.deliver(IMU, speed=0.3, light=light)
        robot.loop.advance_by(0.001)
    robot.loop.advance_by(1.0)
    assert robot.contexts == [("moving", True), ("dark", True)]


@pytest.mark.parametrize(("agent", "told_before"), [(False, 0), (True, 1)])
def test_patches_are_sent_before_the_message_is_made_unless_an_agent_acts_on_it(monkeypatch, agent, told_before):
    robot = with_agent() if agent else Robot().begin()
    reported, apply = len(robot.session.plans()), robot.orders.apply
    seen = []

    def noting(order):
        seen.append(len(robot.session.plans()) - reported)
        apply(order)

    monkeypatch.setattr(robot.orders, "apply", noting)
    robot.sample(speed=0.3)
    assert seen[0] == told_before


def stormy():
    """A robot on which nearly every sample makes a plan."""
    follow = {"activity": [{"stream": "imu", "scoreFrom": "imu.speed"}], "idle": 0.1}
    robot = Robot(tasks=[a_task("slam", **follow), a_task("speech")], contexts=[]).begin()
    robot.loop.advance_by(1.0)
    return robot, len(robot.orders.all), len(robot.session.plans())


def test_in_a_storm_the_first_plan_and_then_the_newest_are_carried_out():
    robot, orders, messages = stormy()
    for speed in (1.0, 2.0, 3.0, 4.0):
        robot.session.deliver(IMU, speed=speed)
        robot.loop.advance_by(0.001)
    assert [order.shares["lab/slam/slam"] for order in robot.orders.all[orders:]] == [500]
    robot.loop.advance_by(0.002)
    assert [order.shares["lab/slam/slam"] for order in robot.orders.all[orders:]] == [500, 800]
    reported = robot.session.plans()[messages:]
    assert [plan["tasks"]["slam"]["share"] for plan in reported] == [0.5, 0.8]
    assert reported[1]["sequence"] == reported[0]["sequence"] + 3
    assert robot.orders.last.shares == {"lab/slam/slam": 800, "lab/speech/speech": 200}


def test_a_plan_that_no_sample_made_does_not_wait():
    robot, orders, _ = stormy()
    robot.session.deliver(IMU, speed=1.0)
    robot.loop.advance_by(0.001)
    robot.place("slam", "speech", cpu=2000)
    assert [order.shares["lab/slam/slam"] for order in robot.orders.all[orders:]] == [500, 1000]


def test_a_stopped_runner_orders_nothing():
    robot, orders, _ = stormy()
    for speed in (1.0, 2.0):
        robot.session.deliver(IMU, speed=speed)
        robot.loop.advance_by(0.001)
    robot.runner.stop()
    robot.loop.advance_by(1.0)
    assert [order.shares["lab/slam/slam"] for order in robot.orders.all[orders:]] == [500]


def test_a_policy_without_any_container_is_still_on_the_bus():
    robot = Robot()
    robot.runner.start()
    robot.place()
    [message] = robot.session.plans()
    assert message["targets"] == []


def test_a_placement_orders_once_whether_it_makes_a_plan_or_not():
    robot = Robot()
    robot.runner.start()
    robot.place("slam", "speech")
    assert len(robot.orders.all) == 1, "with the first plan"
    robot.place("slam", "speech", cpu=2000)
    assert len(robot.orders.all) == 2, "with another plan"
    robot.place("slam", "speech", cpu=2000)
    assert len(robot.orders.all) == 3, "without one: the claim may have changed"


def test_the_same_placement_again_is_ordered_and_not_reported():
    robot = Robot().begin()
    reported, ordered = len(robot.session.published), len(robot.orders.all)
    robot.place("slam", "speech")
    assert len(robot.session.published) == reported
    assert len(robot.orders.all) == ordered + 1


def test_a_question_is_answered_with_the_plan_and_its_reasons():
    robot = Robot().begin()
    plan, why = robot.session.ask(PLAN), robot.session.ask("contextpolicy/lab/robot/explain")
    robot.loop.advance_by(0.01)
    assert plan.answers[0]["sequence"] == robot.session.plans()[-1]["sequence"]
    assert why.answers[0]["policy"] == "lab/robot"


def test_run_and_sequence_only_move_forward_even_when_the_clock_does_not(monkeypatch):
    robot = Robot().begin()
    monkeypatch.setattr("contextpolicy.policies.plan_publisher.time.time", lambda: 1.0)
    robot.edit()
    robot.place("slam", "speech")
    robot.edit()
    robot.place("slam", "speech")
    numbers = [(message["run"], message["sequence"]) for message in robot.session.plans()]
    assert numbers == sorted(set(numbers))


def test_stages_are_reported_with_the_plan_they_belong_to(monkeypatch):
    monkeypatch.setattr(plan_publisher, "time", SimpleNamespace(monotonic=lambda: 100.0, time=time.time))
    robot = Robot()
    robot.runner.publisher.publish_applied("accepted", "lab/slam/slam", 0.8, 100.0)
    robot.begin()
    robot.runner.publisher.publish_applied("accepted", "lab/slam/slam", 0.8, 95.0)
    [step] = [message for key, message in robot.session.published if key == APPLIED]
    last = robot.session.plans()[-1]
    assert (step["run"], step["sequence"]) == (last["run"], last["sequence"])
    assert (step["stage"], step["container"], step["cores"]) == ("accepted", "lab/slam/slam", 0.8)
    assert robot.loop.to_seconds(robot.loop.now) - step["time"] == pytest.approx(5)


# editing and ending


def test_the_previous_version_is_unsubscribed_after_an_edit():
    robot = Robot().begin()
    robot.edit()
    robot.place("slam", "speech")
    ordered = len(robot.orders.all)
    alone = Robot().begin()
    robot.changes = alone.changes = 0
    robot.sample(speed=0.3)
    alone.sample(speed=0.3)
    assert robot.changes == alone.changes
    assert len(robot.orders.all) == ordered + 1
    assert len(robot.session.subscribers) == len(robot.session.tokens) == 1


def test_the_end_of_a_policy_withdraws_its_plans_and_leaves_nothing_declared():
    robot = Robot().begin()
    robot.runner.end()
    assert robot.session.plans()[-1] is None
    assert robot.session.everything_declared() == []


def test_a_stop_leaves_plans_in_force():
    robot = Robot().begin()
    ordered = len(robot.orders.all)
    robot.runner.stop()
    assert None not in robot.session.plans()
    assert len(robot.orders.all) == ordered
    assert robot.session.everything_declared() == []


def test_a_runner_that_never_started_can_be_stopped():
    robot = Robot()
    robot.runner.stop()
    robot.runner.end()
    assert robot.session.published == []


# modes


def test_a_paused_policy_has_no_subscribers():
    robot = Robot(mode="Paused")
    robot.begin()
    assert robot.session.subscribers == []
    assert robot.session.plans() == [None]


def test_a_dry_run_withdraws_what_agents_acted_on():
    robot = Robot(mode="DryRun").begin()
    assert robot.session.plans()[0] is None
    assert robot.session.plans()[-1]["mode"] == "DryRun"


# reporting


def test_a_sample_that_is_not_used_is_counted_and_reported_once():
    robot = Robot().begin()
    labels = {"namespace": "lab", "name": "robot", "stream": "imu", "reason": "undecodable"}
    before = REGISTRY.get_sample_value("contextpolicy_samples_dropped_total", labels) or 0.0
    robot.changes = 0
    for _ in range(3):
        robot.session.deliver_bytes(IMU, b"{")
        robot.loop.advance_by(0.01)
    assert robot.runner.planner.drops["imu", "undecodable"] == 3
    assert robot.changes == 1
    assert REGISTRY.get_sample_value("contextpolicy_samples_dropped_total", labels) == before + 3


def test_streams_keep_no_more_than_there_is_memory_for_also_after_an_edit():
    """64 streams kept a decoded text of 1 MiB each, and expressions saw a copy."""
    streams = [a_stream(f"s{number}") for number in range(64)]
    text = b'{"text": "' + b"x" * 1_000_000 + b'"}'
    robot = Robot(streams=streams, contexts=[]).begin()

    def refused():
        for stream in streams:
            robot.session.deliver_bytes(stream["key"], text)
            robot.loop.advance_by(0.01)
        return {name for name, reason in robot.runner.planner.drops if reason == "memory"}

    first = refused()
    assert 64 - 16 <= len(first) < 64
    robot.edit(streams=streams, contexts=[], tasks=[a_task("slam", priority=2)])
    assert refused() == first


def test_metrics_follow_the_plan():
    robot = Robot().begin()
    robot.sample(speed=0.3)

    def gauge(name, **labels):
        return REGISTRY.get_sample_value(f"contextpolicy_{name}", {"namespace": "lab", "name": "robot", **labels})

    assert gauge("context_active", context="moving") == 1.0
    assert gauge("task_share_cores", task="slam") == 0.8
    assert gauge("task_weight", task="slam") == 4.0
    robot.sample(speed=0.0)
    assert gauge("context_active", context="moving") == 0.0


def test_health_is_published_although_no_plan_changes():
    robot = Robot(streams=[a_stream("imu", staleAfter="1s")], contexts=[]).begin()
    robot.sample(speed=0.0)
    plans = len(robot.session.plans())
    robot.changes = 0
    robot.loop.advance_by(2)
    assert len(robot.session.plans()) == plans
    assert robot.changes


def test_on_plan_is_called_once_per_new_plan():
    robot = Robot().begin()
    robot.plans.clear()
    robot.sample(speed=0.3)
    robot.place("slam", "speech")
    [(policy, plan)] = robot.plans
    assert policy == "lab/robot"
    assert plan is robot.runner.planner.last
    assert plan.arrived is not None


def test_plan_messages_carry_the_arrival_time_of_their_trigger(monkeypatch):
    robot = Robot().begin()
    clock = iter([10.0, 12.5])
    monkeypatch.setattr("contextpolicy.policies.plan_publisher.time.monotonic", lambda: next(clock, 12.5))
    robot.sample(speed=0.3)
    message = robot.session.plans()[-1]
    assert message["trigger"] == pytest.approx(robot.loop.to_seconds(robot.loop.now) - 2.5, abs=0.1)


def test_each_plan_that_min_dwell_holds_back_is_counted_once():
    robot = Robot(enforcement={"minDwell": "10s"}).begin()
    robot.loop.advance_by(20)
    before = held_back()
    for speed in (0.3, 0.0, 0.3, 0.0, 0.3, 0.0):
        robot.sample(speed=speed)
        robot.loop.advance_by(9)
    assert held_back() - before == robot.runner.planner.held_back >= 2


def held_back():
    labels = {"namespace": "lab", "name": "robot"}
    return REGISTRY.get_sample_value("contextpolicy_plans_held_back_total", labels) or 0
