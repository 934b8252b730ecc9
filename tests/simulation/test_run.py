"""Same samples in, same plans out: twice in virtual time, and by hand without Rx."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation import series
from contextpolicy.simulation.comparison import differences
from contextpolicy.simulation.epoch import EPOCH
from contextpolicy.simulation.expectations import parse as parse_expectations
from contextpolicy.simulation.report import as_csv, as_fields, table
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.simulation.samples import Skipped, samples
from contextpolicy.streams import timeline
from tests.planning.quiet import Quiet
from tests.simulation.stories import a_timeline

ROOT = Path(__file__).parents[2]
DELIVERY = load_policy(str(ROOT / "config/policies/delivery-robot.yaml"))
DEMO = timeline.load(ROOT / "timelines/demo.json")
SMALL = Robot({NODE: 1000})


def imu(start: float, end: float, rate: float, speed: float) -> dict[str, Any]:
    value = {"gyro": [speed, 0.0, 0.0], "accel": [0.0, 0.0, 9.81], "speed": speed}
    return {"key": "robot/imu", "encoding": "json", "from": start, "to": end, "rate": rate, "value": value}


def a_policy(streams: list[dict[str, Any]], **spec: Any) -> Any:
    tasks = [{"name": "a", "selector": {"matchLabels": {"app": "a"}}, "idle": 1, "activity": spec.pop("activity", [])}]
    return parse({"metadata": {"name": "p", "namespace": "n"}, "spec": {"streams": streams, "tasks": tasks, **spec}})


@pytest.mark.parametrize("name", ["delivery-robot", "patrol-robot", "speech-chatbot", "paper-listing1"])
def test_same_as_feeding_the_planner_by_hand(name: str) -> None:
    policy = load_policy(str(ROOT / f"config/policies/{name}.yaml"))
    planner = Planner(policy, Quiet(), {})
    plans = planner.start(EPOCH)
    containers = tuple(Container(task.name, task.name, "robot") for task in policy.leaves)
    plans += planner.handle(Placement({"robot": 4000}, containers), EPOCH)
    for at, sample in samples(policy, DEMO.inputs(), Skipped(), Counter()):
        plans += planner.handle(sample, round(EPOCH + at, 6))
    plans += planner.advance(EPOCH + DEMO.duration)

    relative = [replace(plan, time=round(plan.time - EPOCH, 6)) for plan in plans if plan.nodes]
    assert simulate(policy, DEMO, robot=Robot({NODE: 4000})).plans == relative


def test_three_minutes_of_a_200_hz_imu() -> None:
    stretches = [imu(start, start + 3, 200, 0.2 if start // 3 % 2 else 0.0) for start in range(0, 180, 3)]
    mic = {"key": "robot/microphone/level", "encoding": "json", "from": 0, "to": 180, "rate": 10, "value": {"level": 0}}
    run = simulate(DELIVERY, a_timeline(*stretches, mic, duration=180), robot=Robot({NODE: 4000}))

    entered = [plan.time for plan in run.plans if plan.cause == "imu: context moving entered"]
    exited = [plan.time for plan in run.plans if "imu: context moving exited" in plan.cause]
    assert entered == [start + 0.1 for start in range(3, 180, 6)]
    assert exited == [start + 1.0 for start in range(6, 180, 6)]
    assert not run.planner.drops


def test_silence_at_the_end_is_seen_within_the_duration() -> None:
    run = simulate(DELIVERY, a_timeline(imu(0, 2, 50, 0.2), duration=10), robot=Robot({NODE: 2000}))
    assert [plan.time for plan in run.plans if plan.cause == "imu: context moving exited"] == [1.98 + 0.5 + 1.0]


def test_until_is_included() -> None:
    mic = {"key": "robot/microphone/level", "encoding": "json", "from": 0, "to": 10, "rate": 10, "value": {"level": 0}}
    line = a_timeline(imu(0, 10, 50, 0.2), mic, duration=10)
    assert simulate(DELIVERY, line, robot=Robot({NODE: 2000}), until=0.1).plans[-1].contexts == ("moving",)
    assert simulate(DELIVERY, line, robot=Robot({NODE: 2000}), until=0.09).plans[-1].contexts == ()


def test_a_value_stands_for_the_decoded_message_whatever_the_encoding() -> None:
    policy = a_policy(
        [{"name": "imu", "key": "0/imu/**", "encoding": "cdr", "type": "sensor_msgs/msg/Imu"}],
        activity=[{"stream": "imu", "when": "imu.x > 1.0", "score": 3}],
    )
    line = a_timeline({"key": "0/imu/data", "encoding": "json", "at": 1, "value": {"x": 2.0}}, duration=2)
    assert simulate(policy, line, robot=SMALL).planner.scores() == {"a": 3}


def test_a_sample_that_cannot_be_decoded_is_counted_as_on_the_robot() -> None:
    deep: object = 0
    for _ in range(100):
        deep = [deep]
    policy = a_policy([{"name": "imu", "key": "imu"}])
    run = simulate(
        policy,
        a_timeline({"key": "imu", "encoding": "json", "at": 0, "value": deep}, duration=1),
        robot=SMALL,
    )
    assert run.planner.drops == {("imu", "undecodable"): 1}


def test_a_forced_context_holds_throughout() -> None:
    policy = a_policy(
        [{"name": "imu", "key": "imu"}],
        contexts=[{"name": "careful", "tasks": {"a": {"weight": 7}}}],
        force={"context": "careful", "until": "2026-01-01T00:00:00Z"},
    )
    run = simulate(policy, a_timeline({"key": "x", "encoding": "json", "at": 0, "value": 1}, duration=9), robot=SMALL)
    assert [plan.contexts for plan in run.plans] == [("careful",)]


def test_weights_and_scores_are_current_without_share_changes() -> None:
    """One task has the whole node whatever it weighs; its score follows the sensor and then decays."""
    activity = [{"stream": "s", "scoreFrom": "s.x", "hold": "1s", "decay": "1s"}]
    policy = a_policy([{"name": "s", "key": "k"}], activity=activity)
    inputs = [{"key": "k", "encoding": "json", "at": at, "value": {"x": x}} for at, x in ((1, 4.0), (2, 6.0))]
    run = simulate(policy, a_timeline(*inputs, duration=10), robot=SMALL)
    expected = parse_expectations(
        "- {at: 0.5, weights: {a: 1}}\n- {from: 1, to: 1.9, weights: {a: 4}}\n- {at: 2, weights: {a: 6}}\n"
        "- {at: 3.55, weights: {a: {min: 2.9, max: 3.1}}}\n- {at: 9, weights: {a: 1}}\n"
        "- {from: 0, to: 10, plans: {max: 3}}\n",
        policy,
        subject="test",
    )
    assert [str(difference) for difference in differences(run.plans, expected)] == []
    lines = table(run.plans).splitlines()
    assert any(line.split()[:4] == ["1.000", "-", "1000m", "(4)"] for line in lines)
    assert any(line.split()[:4] == ["2.000", "-", "1000m", "(6)"] for line in lines)
    assert '"weight": 6.0' in json.dumps(as_fields(policy, run.plans))
    assert ",a,6.0,6.0,1.0,False" in as_csv(run.plans)


def test_normalised_weights_change_while_shares_do_not() -> None:
    """Figure 5: both tasks are held by their bounds, and their weights still change places."""
    tasks = [
        {"name": name, "selector": {"matchLabels": {"app": name}}, "min": 1, "max": 1, "idle": 1, "activity": activity}
        for name, activity in (("a", [{"stream": "s", "scoreFrom": "s.x"}]), ("b", []))
    ]
    spec = {"streams": [{"name": "s", "key": "k"}], "tasks": tasks}
    policy = parse({"metadata": {"name": "p", "namespace": "n"}, "spec": spec})
    inputs = [{"key": "k", "encoding": "json", "at": 1, "value": {"x": 3.0}}]
    run = simulate(policy, a_timeline(*inputs, duration=2), robot=Robot({NODE: 2000}))
    assert series.shares(run.plans)["a"][-1][1] == series.shares(run.plans)["a"][0][1] == 1.0
    assert series.normalised_weights(run.plans)["a"] == [(0.0, 0.5), (1.0, 0.75)]


def test_sources_behind_one_key_expression_are_kept_apart() -> None:
    def says(side: str, start: float, end: float) -> dict[str, Any]:
        value = {"load": 1.0, "moving": True}
        return {"key": f"lift/{side}", "encoding": "json", "from": start, "to": end, "rate": 2, "value": value}

    lifts = load_policy(str(ROOT / "config/examples/lifts.yaml"))
    run = simulate(lifts, a_timeline(says("left", 1, 9), says("right", 1.25, 5), duration=9), robot=Robot({NODE: 2000}))
    over_time: dict[tuple[str, ...], float] = {}
    for plan in run.plans:
        over_time.setdefault(plan.contexts, plan.time)
    assert over_time == {(): 0, ("lifting",): 1, ("lifting", "both"): 1.25}
    assert [plan.time for plan in run.plans if plan.contexts == ("lifting",)][-1] == 7.75, "right left at 6.75"
