"""Weights are turned into shares of nodes, among pods and within bounds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.planning.allocation.division import divide_nodes
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.allocation.seating import seat_tasks
from contextpolicy.planning.allocation.weights import Weight
from contextpolicy.policy.spec import Scheduler
from tests.planning.builders import a_policy, a_task, on_node, together


def divided(policy, placement, last=None, **weights):
    given = {task.name: Weight(1.0, float(weights.get(task.name, 1.0)), "test") for task in policy.tasks}
    return divide_nodes(seat_tasks(policy, placement), given, last or {}, lambda: given)


def two_tasks(**spec):
    return a_policy(tasks=[a_task("slam"), a_task("speech")], **spec)


def test_each_node_is_divided_by_itself():
    placement = together(on_node("slam", "speech", cores=2, node="front"), on_node("slam", cores=4, node="rear"))
    nodes = divided(two_tasks(), placement, slam=3).nodes
    assert nodes["front"].shares == {"slam": 1500, "speech": 500}
    assert nodes["rear"].shares == {"slam": 4000}


def test_the_reserve_is_kept_back_on_each_node_and_capacity_is_whole_quanta():
    nodes = divided(two_tasks(reserve="305m"), on_node("slam", "speech", cores=2)).nodes
    assert nodes["robot"].capacity == 1690
    assert sum(nodes["robot"].shares.values()) == 1690


@pytest.mark.parametrize(("left", "capacity"), [(705, 700), (1900, 1690)])
def test_capacity_is_limited_by_what_other_policies_leave(left, capacity):
    placement = replace(on_node("slam", "speech", cores=2), left={"robot": left})
    assert divided(two_tasks(reserve="305m"), placement).nodes["robot"].capacity == capacity


def test_several_pods_of_a_task_share_its_part_equally():
    placement = Placement(
        {"robot": 1000},
        (Container("a", "slam", "robot"), Container("b", "slam", "robot"), Container("c", "speech", "robot")),
    )
    node = divided(two_tasks(), placement).nodes["robot"]
    assert node.shares == {"slam": 500, "speech": 500}
    assert node.containers == {"a": 250, "b": 250, "c": 500}


def test_a_request_is_a_floor_of_its_own_container_under_limit_control():
    placement = Placement(
        {"robot": 1000},
        (
            Container("a", "slam", "robot", request=400),
            Container("b", "slam", "robot"),
            Container("c", "speech", "robot"),
        ),
    )
    node = divided(two_tasks(), placement).nodes["robot"]
    assert node.containers == {"a": 400, "b": 100, "c": 500}


@pytest.mark.parametrize("spec", [{"control": "Weight"}, {"control": "Suspend"}, {"scheduler": "Realtime"}])
def test_a_request_is_not_a_floor_under_other_controls(spec):
    placement = Placement(
        {"robot": 1000},
        (
            Container("a", "slam", "robot", request=400),
            Container("b", "slam", "robot"),
            Container("c", "speech", "robot"),
        ),
    )
    containers = divided(two_tasks(enforcement=spec), placement).nodes["robot"].containers
    assert abs(containers["a"] - containers["b"]) <= 10


def test_requests_hold_a_task_of_little_weight_up_and_beyond_its_max():
    requesting = Placement(
        {"robot": 1000}, (Container("a", "slam", "robot", request=200), Container("b", "slam", "robot", request=100))
    )
    placement = together(requesting, on_node("speech"))
    assert divided(two_tasks(), placement, speech=99).nodes["robot"].shares == {"slam": 300, "speech": 700}
    policy = a_policy(tasks=[a_task("slam", max="200m"), a_task("speech")])
    assert divided(policy, placement).nodes["robot"].shares == {"slam": 300, "speech": 700}


def test_a_suspended_task_keeps_its_request():
    placement = together(on_node("slam"), Placement({}, (Container("s", "speech", "robot", request=250),)))
    assert divided(two_tasks(), placement, speech=0).nodes["robot"].shares == {"slam": 750, "speech": 250}


def test_min_and_max_bound_a_share():
    policy = a_policy(tasks=[a_task("slam", max="1500m"), a_task("speech", min="300m")])
    assert divided(policy, on_node("slam", "speech", cores=4), slam=99).nodes["robot"].shares == {
        "slam": 1500,
        "speech": 2500,
    }
    assert divided(policy, on_node("slam", "speech"), slam=99).nodes["robot"].shares == {"slam": 700, "speech": 300}


def test_floors_beyond_the_node_are_scaled_down_and_reported():
    policy = a_policy(tasks=[a_task("slam", min="800m"), a_task("speech", min="400m")])
    division = divided(policy, on_node("slam", "speech"))
    assert sum(division.nodes["robot"].shares.values()) == 1000
    [shortfall] = division.shortfalls
    assert shortfall.message == "the floors sum to 1200m, but the node has 1000m; all are scaled down"


def test_protected_floors_that_just_fit_are_kept():
    tasks = [a_task("slam", min="600m", protected=True), a_task("speech", min="390m", protected=True)]
    policy = a_policy(tasks=[*tasks, a_task("chat", min="500m")])
    division = divided(policy, on_node("slam", "speech", "chat"), chat=9)
    assert division.shares == {"slam": 600, "speech": 390, "chat": 10}
    assert division.shortfalls[0].message.endswith("; all are scaled down")


def test_protected_floors_that_do_not_fit_are_scaled_down_in_every_division():
    """What the last division claimed instead of them must not stand in for them in the next."""
    policy = a_policy(tasks=[a_task(name, min="600m", protected=True) for name in ("slam", "speech")])
    seating = seat_tasks(policy, on_node("slam", "speech"))
    division = None
    for weight in (1.0, 2.0, 3.0):
        given = {"slam": Weight(1.0, 1.0, "test"), "speech": Weight(1.0, weight, "test")}
        division = divide_nodes(seating, given, {}, dict, division and division.claims)
        assert division.nodes["robot"].shares == {"slam": 500, "speech": 500}
        assert [s.message for s in division.shortfalls] == [
            "the floors sum to 1200m, but the node has 1000m; all are scaled down, including those of protected tasks"
        ]


def test_realtime_shares_are_thousandths_of_each_processors_period():
    node = divided(two_tasks(enforcement={"scheduler": "Realtime"}), on_node("slam", "speech", cores=4), slam=2).nodes[
        "robot"
    ]
    assert node.capacity == 4 * 950
    assert node.shares == {"slam": 4 * 633, "speech": 4 * 317}


def test_a_reserve_is_kept_back_from_the_realtime_budget_too():
    policy = two_tasks(enforcement={"scheduler": "Realtime"}, reserve="1")
    assert divided(policy, on_node("slam", "speech", cores=4)).nodes["robot"].capacity == 3000


def test_a_node_that_cannot_do_realtime_divides_its_cores():
    placement = replace(on_node("slam", "speech", cores=4), fair_only=frozenset({"robot"}))
    node = divided(two_tasks(enforcement={"scheduler": "Realtime"}), placement).nodes["robot"]
    assert (node.capacity, node.scheduler) == (4000, Scheduler.CFS)


def test_a_suspended_task_is_not_counted_as_resting():
    seating = seat_tasks(two_tasks(), on_node("slam", "speech"))
    at_rest = {"slam": Weight(0, 1, ""), "speech": Weight(0, 0, "", able=False)}
    division = divide_nodes(seating, dict.fromkeys(at_rest, Weight(0, 0, "")), {}, lambda: at_rest)
    assert division.nodes["robot"].shares == {"slam": 990, "speech": 10}
    assert division.resting == {"slam"}


def test_a_node_on_which_all_is_suspended_gives_each_the_least():
    placement = together(on_node("slam", cores=2, request=30), on_node("slam", "speech", cores=2, node="rear"))
    division = divided(two_tasks(), placement, slam=0, speech=0)
    assert division.shares == {"slam": 40, "speech": 10}
    assert {node.basis for node in division.nodes.values()} == {"Nothing"}
    assert division.shortfalls == ()


def test_other_nodes_are_divided_by_weight_all_the_same():
    placement = together(on_node("slam", node="front"), on_node("speech", node="rear"))
    division = divided(two_tasks(), placement, slam=0)
    assert (division.shares["slam"], division.shares["speech"]) == (10, 1000)


def test_a_node_too_small_for_its_tasks_says_so_and_others_are_divided():
    placement = together(on_node("slam", "speech", cores=0.01, node="tiny"), on_node("slam", node="big"))
    division = divided(two_tasks(), placement)
    assert division.nodes.keys() == {"big"}
    assert division.shortfalls[0].message.startswith("node tiny keeps its last plan: 1 units cannot be divided")
    last = {"tiny": division.nodes["big"]._replace(capacity=20)}
    again = divided(two_tasks(), placement, last)
    assert again.nodes["tiny"] == last["tiny"]
    assert again.nodes["big"] == division.nodes["big"]


def test_a_container_on_a_node_of_unknown_size_waits():
    placement = Placement({}, (Container("a", "slam", "somewhere"),))
    assert divided(two_tasks(), placement).nodes == {}


def test_containers_of_other_tasks_are_ignored():
    placement = on_node("slam", "speech", "arm")
    assert divided(two_tasks(), placement).nodes["robot"].containers == {"slam@robot": 500, "speech@robot": 500}


def test_many_pods_on_a_crowded_node_still_get_a_quantum_each():
    crowd = tuple(Container(f"{task}{n}", task, "robot") for task in ("slam", "speech") for n in range(5))
    policy = a_policy(tasks=[a_task("slam", min="1"), a_task("speech")])
    node = divided(policy, Placement({"robot": 200}, crowd)).nodes["robot"]
    assert sum(node.containers.values()) == 200
    assert min(node.containers.values()) >= 10
