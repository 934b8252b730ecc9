"""Notes say in sentences what the plans do not show."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.simulation.notes import MOST_REASONS, MOST_SHORTFALLS, notes
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams.timeline import RECORDED, Timeline, TimelineEntry
from tests.simulation.stories import a_context, a_policy, a_timeline, at

S = {"name": "s", "key": "s"}
DOUBLES = {"a": {"weight": 2}}


def reported(policy, *inputs, robot=None, **options):
    robot = robot or Robot()
    return notes(policy, robot, simulate(policy, a_timeline(*inputs), robot=robot, **options))


def test_a_stream_that_the_timeline_never_feeds():
    policy = a_policy(S, {"name": "u", "key": "u/**"})
    assert reported(policy, at(0, 1)) == ["the timeline has no input for stream u (u/**)"]


def test_a_key_that_no_stream_reads_and_a_recording():
    recorded = {"key": "s", "encoding": "binary", "from": 0, "to": 1, "dataset": "a/b"}
    assert reported(a_policy(S), at(0, 1), at(0, 1, "x"), recorded) == [
        "no stream reads x",
        "s is a data set, without values",
    ]


def test_an_explicit_null_is_a_value():
    assert reported(a_policy(S, contexts=[a_context("s.value == null", **DOUBLES)]), at(0, None)) == []


def test_a_drop_quotes_the_decoder():
    policy = a_policy({**S, "timestamp": "stamp"})
    message = "stream s: the json payload has the timestamp 'noon': expected a number, or a map of sec and nanosec"
    assert reported(policy, at(0, {"stamp": "noon"}), at(1, {"stamp": "noon"})) == [f"{message}, 2 times"]


def test_a_drop_by_the_stream_has_its_reason():
    assert reported(a_policy({**S, "filter": "s.value > 1.0"}), at(0, 0.5)) == ["stream s: filtered, once"]


def test_an_expression_that_fails_has_the_value_and_its_kind_also_if_it_recovers():
    policy = a_policy(S, contexts=[a_context("s.value > 1.0", **DOUBLES)])
    (note,) = reported(policy, at(0, "loud"), at(1, "louder"), at(2, 2.0))
    assert note.startswith("s.value > 1.0: ")
    assert note.endswith('; s.value is "loud", a string; 2 times')


def test_a_condition_that_still_waits_says_for_which_stream():
    policy = a_policy(S, {"name": "u", "key": "u"}, contexts=[a_context("s.value > 1.0 && u.x > 1", **DOUBLES)])
    (_, note) = reported(policy, at(2, 3.0))
    assert note.startswith("context c waits for stream u at the end, since 0 s: ")


def test_a_stream_whose_own_expression_fails_says_how():
    feature = {"name": "top", "op": "max", "of": "s.x", "over": "1s"}
    (note,) = reported(a_policy({**S, "features": [feature]}), at(0, {"y": 1}), at(1, {"y": 1}))
    assert note.startswith("stream s, samples not used: s.x: ")
    assert note.endswith("; 2 times")


def test_a_shortfall_is_reported_with_its_first_time():
    policy = a_policy(S, tasks=("a", "b"), needs={"cores": 3}, contexts=[a_context("s.value > 1.0", b={"weight": 9})])
    assert reported(policy, at(0, 0.0), at(5, 2.0)) == [
        "not feasible from 0 s: a needs 3 cores, but gets 2",
        "not feasible from 5 s: a needs 3 cores, but gets 400m",
    ]


def test_a_long_list_of_shortfalls_ends():
    policy = a_policy(S, tasks=("a", "b"), needs={"cores": 4}, contexts=[])
    run = simulate(policy, a_timeline(at(0, 1)), robot=Robot({NODE: 4000}))
    (plan,) = run.plans
    run.plans = [
        replace(plan, shortfalls=tuple(replace(plan.shortfalls[0], message=str(i)) for i in range(MOST_SHORTFALLS + 3)))
    ]
    assert notes(policy, Robot(), run)[-1] == "not feasible in 3 more ways"


def test_a_node_too_small_for_a_plan_is_reported():
    policy = a_policy(S, tasks=("a", "b"))
    (note,) = reported(policy, at(0, 1), robot=Robot({"robot": 10}))
    assert note.startswith("there is no plan: node robot keeps its last plan: 1 units cannot be divided over 2 tasks")


@pytest.mark.parametrize(("fallback", "count"), [("CFS", 0), ("None", 1)])
def test_a_node_that_is_left_alone(fallback, count):
    policy = a_policy(S, enforcement={"scheduler": "Realtime", "realtimeFallback": fallback})
    robot = Robot({"robot": 4000, "arm": 1000}, fair_only=frozenset({"arm"}))
    assert reported(policy, at(0, 1), robot=robot).count("node arm can't do realtime and is left alone") == count


def recorded(payloads, kind):
    """A recording of one topic, `odom`, of a ROS type."""
    blank = TimelineEntry(0.0, 0.0, "odom", RECORDED, None, None, None, None, type=kind)
    entries = tuple(replace(blank, start=at / 10, payload=payload) for at, payload in enumerate(payloads))
    return Timeline("run", 10.0, entries, begin=1_795_300_000.0)


ODOM = {"name": "odom", "key": "odom", "encoding": "cdr", "type": "std_msgs/msg/String"}
BROKEN = [b"\x00\x01\x00\x00" + b"\xff" * 4 + bytes(length) for length in range(40)]


def noted(payloads, kind):
    policy, robot = a_policy(ODOM), Robot()
    return notes(policy, robot, simulate(policy, recorded(payloads, kind), robot=robot))


def test_a_recording_of_another_type_is_reported_once():
    assert noted(BROKEN, "nav_msgs/msg/Odometry") == [
        "the recording has nav_msgs/msg/Odometry, but stream odom expects std_msgs/msg/String: no messages are read"
    ]


@pytest.mark.parametrize("kind", ["std_msgs/msg/String", ""])
def test_reasons_that_differ_in_a_number_are_not_reported_one_by_one(kind):
    reported = noted([*BROKEN, *(bytes(length) for length in range(4))], kind)
    assert 1 <= len(reported) <= MOST_REASONS + 1
    assert all(note.startswith("stream odom") for note in reported)
