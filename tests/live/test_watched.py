"""What the operator shows of itself, in virtual time."""

from __future__ import annotations

import json

import pytest

from contextpolicy.policy.parsing import parse
from contextpolicy.simulation.run import simulate
from contextpolicy.streams import timeline


def test_the_board_of_a_policy(operator):
    [board] = operator.operator.queries.boards()
    assert board["policy"] == "lab/robot"
    assert {condition["type"]: condition["status"] for condition in board["conditions"]}["Ready"] == "True"
    assert board["streams"]["imu"]["age"] == pytest.approx(5.0, abs=1.0)
    assert board["streams"]["imu"]["samples"] == 3
    assert board["contexts"]["moving"]["active"] is False
    assert board["contexts"]["moving"]["why"].startswith("Context moving does not hold: ")
    assert board["why"]["slam"][0].startswith("slam gets 500m")
    assert [(one["task"], one["cores"], one["limit"], one["use"]) for one in board["containers"]] == [
        ("slam", 0.5, 0.5, None),
        ("speech", 0.5, 0.5, None),
    ]
    assert board["plan"]["sequence"] == 3
    assert board["reactions"]["count"] > 0
    assert json.loads(json.dumps(board)) == board


def test_the_plans_of_the_last_minutes_each_once(operator):
    plans = operator.operator.queries.plans("lab/robot", 0.0)
    assert [plan["contexts"] for plan in plans][-3:] == [[], ["moving"], []]
    assert plans[-1]["published"] - plans[-2]["published"] == pytest.approx(10.0, abs=1.0)
    assert operator.operator.queries.plans("lab/robot", plans[-1]["published"]) == []
    assert operator.operator.queries.plans("lab/robot", plans[-2]["published"]) == plans[-1:]
    assert operator.operator.queries.plans("lab/nobody", 0.0) == []


def test_what_happened_on_the_robot_happens_on_the_desk(operator):
    recorded = operator.operator.queries.recording("lab/robot", 300.0)
    policy = parse(recorded["policy"])
    run = simulate(policy, timeline.parse(recorded["timeline"]), cores=1)
    shares = [{name: task.share / 1000 for name, task in plan.tasks.items()} for plan in run.plans]
    on_the_robot = [{name: task["share"] for name, task in plan["tasks"].items()} for plan in recorded["plans"]]
    assert [shares[0], *shares[1:]] == on_the_robot[-len(shares) :]
    assert [plan.contexts for plan in run.plans] == [(), ("moving",), ()]


def test_of_a_policy_that_is_not_there_there_is_nothing(operator):
    assert operator.operator.queries.recording("lab/nobody", 60.0) is None
    assert operator.operator.queries.explanation("lab/nobody") is None
    assert operator.operator.queries.explanation("lab/robot")["policy"] == "lab/robot"


def test_the_bus_answers_with_the_board_too(operator):
    operator.loop.inline = False
    query = operator.session.ask("contextpolicy/lab/robot/board")
    operator.turn()
    assert query.answers[0]["policy"] == "lab/robot"
