"""What was recorded, replayed: the same plans come out."""

from __future__ import annotations

import json

import pytest

from contextpolicy.policy.parsing import parse
from contextpolicy.recorder.flight_recorder import BUDGET, FlightRecorder, PlanRecord, SampleRecord
from contextpolicy.recorder.recording import key_without_wildcards, recording
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams import timeline
from tests.planning.builders import a_stream
from tests.policies.builders import IMU, a_policy


@pytest.fixture
def flight():
    """A recorder of one policy, and a way to let samples come."""
    recorder = FlightRecorder(BUDGET, 60.0)
    records = recorder.begin("lab/robot", ["imu", "scan"])

    def take(at, stream="imu", key="", payload=None, **value):
        recorder.take_sample(records, SampleRecord(at, stream, payload or json.dumps(value).encode(), b"", key))

    return recorder, records, take


def test_it_is_a_timeline_that_simulate_reads(flight):
    _, records, take = flight
    policy = parse(a_policy())
    for at, speed in ((100.0, 0.0), (105.0, 0.3), (110.0, 0.0)):
        take(at, speed=speed)
    made = recording(policy, records, now=115.0, last=300.0)
    inputs = timeline.parse(made["timeline"])
    assert inputs.duration == 15.0
    assert [(one.at, one.key, one.value) for one in inputs.inputs()] == [
        (0.0, IMU, {"speed": 0.0}),
        (5.0, IMU, {"speed": 0.3}),
        (10.0, IMU, {"speed": 0.0}),
    ]
    run = simulate(policy, inputs, robot=Robot({NODE: 1000}))
    assert [(plan.time, plan.contexts) for plan in run.plans] == [(0.0, ()), (5.0, ("moving",)), (10.0, ())]


def test_an_excerpt_begins_with_the_last_known_values(flight):
    _, records, take = flight
    take(100.0, speed=0.3)
    take(190.0, "other", a=1)
    made = recording(parse(a_policy()), records, now=200.0, last=20.0)["timeline"]
    assert made["inputs"] == [{"at": 0.0, "key": IMU, "encoding": "json", "value": {"speed": 0.3}}]
    assert made["duration"] == 10.0, "earlier there is nothing left"
    assert "1 of a stream that the policy no longer has" in made["description"]


def test_plans_are_unchanged_but_use_the_timelines_time(flight):
    recorder, records, take = flight
    take(100.0, speed=0.0)
    recorder.take_plan("lab/robot", PlanRecord(101.5, b'{"sequence": 3, "cause": "imu"}'))
    assert recording(parse(a_policy()), records, now=110.0, last=60.0)["plans"] == [
        {"at": 1.5, "sequence": 3, "cause": "imu"}
    ]


def test_a_sample_of_two_streams_is_one_input(flight):
    _, records, take = flight
    policy = parse(a_policy(streams=[a_stream("imu"), a_stream("all", key="robot/*")]))
    take(100.0, speed=0.3)
    take(100.001, "all", key=IMU, speed=0.3)
    take(101.0, "all", key="robot/gps", speed=0.3)
    made = recording(policy, records, now=102.0, last=60.0)["timeline"]["inputs"]
    assert [(one["at"], one["key"]) for one in made] == [(0.0, IMU), (1.0, "robot/gps")]


def test_nan_is_null_and_reported(flight):
    _, records, take = flight
    policy = parse(a_policy(streams=[a_stream("imu", encoding="cbor")]))
    take(100.0, payload=bytes.fromhex("a165737065656 4f97c00".replace(" ", "")))
    take(101.0, payload=b"\xff")
    made = recording(policy, records, now=102.0, last=60.0)["timeline"]
    assert made["inputs"][0]["value"] == {"speed": None}
    assert "1 numbers that JSON can't represent (NaN, infinity), now null" in made["description"]
    assert "1 undecodable" in made["description"]


@pytest.mark.parametrize(
    ("key", "plain"),
    [("robot/imu", "robot/imu"), ("robot/*/imu", "robot/any/imu"), ("robot/**", "robot/any"), ("r/cam$*", "r/any")],
)
def test_wildcards_of_an_expression_are_replaced(key, plain):
    assert key_without_wildcards(key) == plain
