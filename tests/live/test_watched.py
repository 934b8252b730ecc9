"""What the operator shows of itself, in virtual time."""

from __future__ import annotations

import json
import time
from types import SimpleNamespace

import pytest

from contextpolicy.explain.palette import context_colors, task_colors
from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams import timeline
from tests.planning.builders import a_stream
from tests.policies.builders import a_policy


def test_the_board_of_a_policy(operator):
    [board] = operator.operator.queries.boards()
    assert board["policy"] == "lab/robot"
    assert {condition["type"]: condition["status"] for condition in board["conditions"]}["Ready"] == "True"
    assert board["streams"]["imu"]["age"] == pytest.approx(5.0, abs=1.0)
    assert board["streams"]["imu"]["samples"] == 3
    assert board["contexts"]["moving"]["active"] is False
    assert board["contexts"]["moving"]["color"] == context_colors(["moving"])["moving"]
    assert board["contexts"]["moving"]["why"].startswith("Context moving does not hold: ")
    assert board["why"]["slam"][0].startswith("slam gets 500m")
    assert [(one["task"], one["cores"], one["limit"], one["use"]) for one in board["containers"]] == [
        ("slam", 0.5, 0.5, None),
        ("speech", 0.5, 0.5, None),
    ]
    assert board["plan"]["sequence"] == 4
    assert board["colors"] == task_colors(["slam", "speech"])
    assert board["reactions"]["count"] > 0
    assert json.loads(json.dumps(board)) == board


def test_board_has_module_health_while_fresh(operator):
    streams = [a_stream("imu", staleAfter="10s"), a_stream("speech", key="robot/speech/health")]
    operator.loop.inline = False
    operator.apply(a_policy(generation=2, streams=streams))
    operator.sample("robot/speech/health", misses=0.25, queue=3, latency=None)
    [board] = boards(operator)
    assert board["health"] == {"speech": {"misses": 0.25, "queue": 3, "latency": None}}
    operator.turn(6.0)
    [board] = boards(operator)
    assert board["health"] == {}


@pytest.mark.parametrize("said", [{"misses": "many"}, {"misses": True}, {"queue": {}}])
def test_invalid_health_is_unknown(operator, said):
    operator.loop.inline = False
    operator.apply(a_policy(generation=2, streams=[a_stream("imu"), a_stream("x", key="robot/speech/health")]))
    operator.sample("robot/speech/health", **said)
    [board] = boards(operator)
    assert set(board["health"]["speech"].values()) == {None}


def boards(operator):
    operator.loop.inline = True
    found = operator.operator.queries.boards()
    operator.loop.inline = False
    return found


def test_recent_plans_are_returned_once(operator):
    plans = operator.operator.queries.plans("lab/robot", 0.0)
    assert [plan["contexts"] for plan in plans][-3:] == [[], ["moving"], []]
    assert plans[-1]["published"] - plans[-2]["published"] == pytest.approx(10.0, abs=1.0)
    assert operator.operator.queries.plans("lab/robot", plans[-1]["published"]) == []
    assert operator.operator.queries.plans("lab/robot", plans[-2]["published"]) == plans[-1:]
    assert operator.operator.queries.plans("lab/nobody", 0.0) == []


def test_a_plan_comes_once_however_long_reading_two_clocks_takes(operator, monkeypatch):
    queries = operator.operator.queries
    [*_, last] = queries.plans("lab/robot", 0.0)
    exact = time.monotonic
    clock = SimpleNamespace(monotonic=lambda: exact() - 5e-5, time=time.time)  # another thread had its turn in between
    monkeypatch.setattr("contextpolicy.policies.queries.time", clock)
    assert queries.plans("lab/robot", last["published"]) == []


def test_late_viewers_see_an_ended_pause(operator):
    """The plan before it was not in force until the next one."""
    operator.loop.inline = False
    [before] = boards(operator)
    operator.apply(a_policy(generation=2, mode="Paused"))
    operator.turn(10.0)
    paused = plans(operator)
    operator.apply(a_policy(generation=3))
    operator.turn(10.0)
    [*_, last, resumed] = plans(operator)
    assert (last["until"], resumed["until"]) == (pytest.approx(before["now"], abs=0.1), None)
    assert resumed["published"] - last["until"] == pytest.approx(10.0, abs=0.5)
    assert plans(operator, paused[-2]["published"])[0] == last
    assert plans(operator, last["published"]) == [last, resumed], "its end is news to those who have its beginning"
    assert plans(operator, last["until"]) == [resumed]


def plans(operator, since=0.0):
    operator.loop.inline = True
    found = operator.operator.queries.plans("lab/robot", since)
    operator.loop.inline = False
    return found


def test_recreated_policy_has_its_own_uid_and_plans(operator):
    operator.loop.inline = False
    [before] = boards(operator)
    operator.delete(a_policy())
    operator.settle()
    again = a_policy()
    operator.apply({**again, "metadata": {**again["metadata"], "uid": "uid-again"}})
    [after] = boards(operator)
    assert (before["uid"], after["uid"]) == ("uid-robot", "uid-again")
    assert all(plan["published"] > before["now"] for plan in plans(operator))


def test_times_follow_a_clock_step(operator):
    [before] = boards(operator)
    operator.step = 3600.0
    [after] = boards(operator)
    for found in (lambda board: board["now"], lambda board: board["plan"]["time"]):
        assert found(after) - found(before) == pytest.approx(3600.0)
    operator.loop.inline = True
    assert operator.operator.queries.plans("lab/robot", after["now"] - 60)


def test_recording_replays_to_the_same_plans(operator):
    recorded = operator.operator.queries.recording("lab/robot", 300.0)
    policy = parse(recorded["policy"])
    run = simulate(policy, timeline.parse(recorded["timeline"]), robot=Robot({NODE: 1000}))
    shares = [{name: task.share / 1000 for name, task in plan.tasks.items()} for plan in run.plans]
    on_the_robot = [{name: task["share"] for name, task in plan["tasks"].items()} for plan in recorded["plans"]]
    assert [shares[0], *shares[1:]] == on_the_robot[-len(shares) :]
    assert [plan.contexts for plan in run.plans] == [(), ("moving",), ()]


def test_an_unknown_policy_has_no_answer(operator):
    assert operator.operator.queries.recording("lab/nobody", 60.0) is None
    assert operator.operator.queries.explanation("lab/nobody") is None
    assert operator.operator.queries.explanation("lab/robot")["policy"] == "lab/robot"


def test_the_bus_answers_with_the_board_too(operator):
    operator.loop.inline = False
    query = operator.session.ask("contextpolicy/lab/robot/board")
    operator.turn()
    assert query.answers[0]["policy"] == "lab/robot"
