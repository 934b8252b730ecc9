"""A policy's plans as an order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.order import order_of
from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT
from contextpolicy.planning.allocation.placement import Container
from contextpolicy.planning.allocation.plan import NodePlan
from contextpolicy.policy.parsing import parse
from tests.planning.builders import a_task
from tests.policies.builders import a_policy

SLAM, SPEECH = Container("a", "slam", "robot-1"), Container("b", "speech", "robot-2")


def test_containers_of_realtime_nodes_are_left_to_the_agent():
    nodes = {"robot-1": NodePlan(2000, {}, {"a": 1500})}
    order = order_of(parse(a_policy()), (SLAM, SPEECH), nodes, realtime={"robot-2"})
    assert order.claimed == {"a"}
    assert (order.shares, order.capacity) == ({"a": 1500}, {"robot-1": 2000})
    assert order.nodes == {"a": "robot-1", "b": "robot-2"}


def test_a_container_whose_node_has_no_plan_yet_is_claimed_without_a_share():
    order = order_of(parse(a_policy()), (SLAM,), {})
    assert (order.claimed, order.shares, order.limits) == (frozenset("a"), {}, {})


def test_the_nodes_with_agents_are_known_also_where_no_plan_is_yet():
    assert order_of(parse(a_policy()), (SLAM,), {}, agents={"robot-1"}).agents == {"robot-1"}


def controlled(control, **more):
    policy = parse(
        a_policy(
            enforcement={"control": control},
            tasks=[a_task("slam", max="1500m"), a_task("speech", protected=True), a_task("map")],
            contexts=[],
        )
    )
    containers = [Container(name[0], name, "robot") for name in ("slam", "map")] + [Container("p", "speech", "robot")]
    shares = {"s": 1490, "p": 100, "m": 10}
    node = NodePlan(2000, {"slam": 1490, "speech": 100, "map": 10}, shares, suspended=frozenset({"map"}))
    return order_of(policy, containers, {"robot": node}, **more)


def test_limits_are_shares_and_bounded():
    order = controlled("Limit")
    assert (order.limits, order.requests, order.bounded) == ({}, {}, True)


def test_suspension_alone_caps_what_is_suspended_or_has_a_max():
    order = controlled("Suspend")
    assert (order.limits, order.requests, order.bounded) == ({"s": 1500, "p": None, "m": 10}, {}, False)
    assert [order.leaves_alone(one) for one in "spm"] == [False, True, False]


def test_weights_are_requests_that_fit_into_the_node_whatever_the_plan():
    order = controlled("Weight")
    assert order.limits == {"s": 1500, "p": None, "m": 10}
    factor = 2000 / (1500 + 2000 + 2000)
    assert order.requests == {"s": int(1490 * factor), "p": int(PROTECTED_WEIGHT * factor), "m": 0}
    assert not order.leaves_alone("p")


def test_other_pods_requests_leave_less_room_than_the_node_divides():
    assert controlled("Weight", room={"robot": 1100}).requests["s"] == int(1490 * 1100 / 5500)
    assert controlled("Weight", room={"robot": 9000}).requests["s"] == int(1490 * 2000 / 5500)


def test_beside_an_agent_no_request_moves():
    order = controlled("Weight", agents={"robot"})
    assert (order.requests, order.leaves_alone("p")) == ({}, True)


def test_a_node_without_room_leaves_requests_of_nothing():
    policy = parse(a_policy(enforcement={"control": "Weight"}, contexts=[]))
    order = order_of(policy, [SLAM], {"robot": NodePlan(0, {"slam": 10}, {SLAM.id: 10})})
    assert order.requests == {SLAM.id: 0}


@given(
    st.lists(st.tuples(st.none() | st.integers(1, 400), st.integers(1, 400)), min_size=1, max_size=9),
    st.integers(0, 2000),
)
def test_requests_never_exceed_the_room(tasks, room):
    specs = [a_task(f"t{n}", **({} if most is None else {"max": f"{most * 10}m"})) for n, (most, _) in enumerate(tasks)]
    policy = parse(a_policy(enforcement={"control": "Weight"}, tasks=specs, contexts=[]))
    containers = [Container(f"c{n}", f"t{n}", "robot") for n in range(len(tasks))]
    shares = {f"c{n}": share * 10 for n, (_, share) in enumerate(tasks)}
    order = order_of(policy, containers, {"robot": NodePlan(1000, {}, shares)}, room={"robot": room})
    assert sum(order.requests.values()) <= min(1000, room)
