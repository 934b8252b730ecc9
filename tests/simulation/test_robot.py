"""Nodes, replicas, requests and nodes that can't do realtime, as the planner sees them."""

from __future__ import annotations

from contextpolicy.planning.allocation.placement import Container
from contextpolicy.policy.spec import Scheduler
from contextpolicy.simulation.robot import Robot
from contextpolicy.simulation.run import simulate
from tests.simulation.stories import a_policy, a_timeline, at

S = {"name": "s", "key": "s"}
TWO = a_policy(S, tasks=("a", "b"))
LINE = a_timeline(at(0, 1))
NODES = {"head": 2000, "arm": 500}


def test_each_task_runs_once_on_the_first_node_unless_said_otherwise():
    placement = Robot(NODES).placement(TWO)
    assert placement.allocatable == NODES
    assert placement.containers == (Container("a", "a", "head"), Container("b", "b", "head"))


def test_replicas_take_turns_over_the_nodes_of_their_task():
    robot = Robot(NODES, places={"a": ("head", "arm")}, replicas={"a": 3, "b": 2}, requests={"a": 250})
    assert [(c.id, c.node, c.request) for c in robot.placement(TWO).containers] == [
        ("a", "head", 250),
        ("a-2", "arm", 250),
        ("a-3", "head", 250),
        ("b", "head", 0),
        ("b-2", "head", 0),
    ]


def test_a_task_on_several_nodes_has_a_pod_on_each():
    robot = Robot(NODES, places={"a": ("head", "arm")})
    assert [c.node for c in robot.placement(TWO).containers if c.task == "a"] == ["head", "arm"]


def test_a_node_without_realtime_falls_back_or_is_left_alone():
    robot = Robot(NODES, places={"b": ("arm",)}, fair_only=frozenset({"arm"}))
    (plan,) = simulate(a_policy(S, tasks=("a", "b"), enforcement={"scheduler": "Realtime"}), LINE, robot=robot).plans
    assert {name: node.scheduler for name, node in plan.nodes.items()} == {
        "head": Scheduler.REALTIME,
        "arm": Scheduler.CFS,
    }
    strict = a_policy(S, tasks=("a", "b"), enforcement={"scheduler": "Realtime", "realtimeFallback": "None"})
    (plan,) = simulate(strict, LINE, robot=robot).plans
    assert list(plan.nodes) == ["head"]
