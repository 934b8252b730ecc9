"""A policy's plans as an order."""

from __future__ import annotations

from contextpolicy.actuators.order import order_of
from contextpolicy.planning.allocation.placement import Container
from contextpolicy.planning.allocation.plan import NodePlan
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.spec import Control
from tests.planning.builders import a_task
from tests.policies.builders import a_policy

SLAM, SPEECH = Container("a", "slam", "robot-1"), Container("b", "speech", "robot-2")


def test_containers_of_realtime_nodes_are_left_to_the_agent():
    order = order_of(parse(a_policy()), (SLAM, SPEECH), {"robot-1": NodePlan(2000, {}, {"a": 1500})}, {"robot-2"})
    assert order.claimed == {"a"}
    assert (order.shares, order.capacity) == ({"a": 1500}, {"robot-1": 2000})
    assert order.nodes == {"a": "robot-1", "b": "robot-2"}


def test_a_container_whose_node_has_no_plan_yet_is_claimed_without_a_share():
    order = order_of(parse(a_policy()), (SLAM,), {}, frozenset())
    assert (order.claimed, order.shares, order.ceilings) == (frozenset("a"), {}, {})


def test_a_ceiling_is_the_tasks_max_or_all_of_its_node():
    policy = parse(a_policy(control="Weight", tasks=[a_task("slam", max="1500m"), a_task("speech")], contexts=[]))
    nodes = {"robot-1": NodePlan(2000, {}, {}), "robot-2": NodePlan(4000, {}, {})}
    order = order_of(policy, (SLAM, SPEECH), nodes, frozenset())
    assert (order.control, order.ceilings) == (Control.WEIGHT, {"a": 1500, "b": 4000})
