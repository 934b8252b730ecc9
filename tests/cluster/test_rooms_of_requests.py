"""The room that weights have as requests."""

from __future__ import annotations

from dataclasses import replace

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.policy.spec import Mode
from tests.cluster.builders import NODE, a_pod, cpu
from tests.cluster.claimants import NODES, policy_of, views
from tests.cluster.claiming import claim

WEIGHTED = {"enforcement": {"control": "Weight"}}


def room_of(*policies, pods, elsewhere=None, arriving=0, **more):
    """`elsewhere` is what pods of other namespaces request and have been granted, `arriving` what they wait for."""
    others = elsewhere or {}
    requested = {NODE: others.get(NODE, 0) + arriving}
    found = claim(policies, pods, NODES, elsewhere=requested, weighing=others, **more)
    return {policy.name: found[policy.reference].room.get(NODE) for policy in policies}


def test_room_is_what_other_pods_requests_leave():
    pods = views("slam", "driver")
    robot = policy_of("robot", "slam", **WEIGHTED)
    assert room_of(robot, pods=pods, elsewhere={NODE: 500}) == {"robot": 2000 - 100 - 500}
    assert room_of(policy_of("robot", "slam", reserve="1500m", **WEIGHTED), pods=pods) == {"robot": 500}
    assert room_of(robot, pods=pods, elsewhere={NODE: 3000}) == {"robot": 0}


def test_a_request_that_the_policy_moved_takes_no_room():
    moved = [view(a_pod("slam", {"slam": cpu("900m", "1")}))]
    assert room_of(policy_of("robot", "slam", **WEIGHTED), pods=moved) == {"robot": 2000}


def test_room_exists_only_under_weight_without_an_agent():
    pods = views("slam")
    assert room_of(policy_of("robot", "slam", enforcement={"control": "Limit"}), pods=pods) == {"robot": None}
    assert room_of(policy_of("robot", "slam", **WEIGHTED), pods=pods, agents={NODE}) == {"robot": None}


def test_policies_sharing_a_node_split_the_room_by_their_parts():
    first = policy_of("first", "slam", reserve="500m", **WEIGHTED)
    second = policy_of("second", "speech", **WEIGHTED)
    pods = views("slam", "speech", "driver")
    assert room_of(first, second, pods=pods, elsewhere={NODE: 900}) == {"first": 750, "second": 250}


def test_dry_run_policy_reports_its_hypothetical_room():
    first = policy_of("first", "slam", reserve="1", **WEIGHTED)
    dry = replace(policy_of("dry", "speech", **WEIGHTED), mode=Mode.DRY_RUN)
    pods = views("slam", "speech", "driver")
    assert room_of(first, dry, pods=pods) == {"first": 1000, "dry": 950}


def test_another_namespaces_policy_does_not_cut_requests_below_ones_own():
    """The robot may use no more than it requests, and all were cut by one factor to fit beside the driver."""
    robot = policy_of("robot", "slam", **WEIGHTED)
    other = replace(policy_of("other", "arm", **WEIGHTED), namespace="elsewhere")
    pods = [
        view(a_pod("slam", {"slam": cpu("600m", "600m")})),
        view(a_pod("arm", {"arm": cpu("10m", "64")}, namespace="elsewhere")),
    ]
    assert room_of(other, robot, pods=pods, elsewhere={NODE: 500}) == {"robot": 600, "other": 900}


def test_a_pod_that_arrives_has_room_as_far_as_it_fits_beside_what_all_request():
    """Who may make pods can name the node in them: the kubelet refuses them, and their Deployment makes more."""
    robot = policy_of("robot", "slam", **WEIGHTED)
    pods = [view(a_pod("slam", {"slam": cpu("600m", "1")}))]
    assert room_of(robot, pods=pods, elsewhere={NODE: 500}, arriving=300) == {"robot": 1200}
    assert room_of(robot, pods=pods, elsewhere={NODE: 500}, arriving=64_000) == {"robot": 600}
    refused = view(a_pod("refused", {"refused": cpu("64", "64")}) | {"status": {"phase": "Pending"}})
    assert room_of(robot, pods=[*pods, refused], elsewhere={NODE: 500}) == {"robot": 600}
