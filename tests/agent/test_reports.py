"""What the operator makes of the agents' reports."""

from __future__ import annotations

import json

import pytest

from contextpolicy.agent.capabilities import Facts, missing
from contextpolicy.cluster.agents import NO_AGENT, UNREADABLE, realtime_obstacle, with_realtime
from contextpolicy.cluster.claims import Claim
from contextpolicy.planning.parsing import parse
from contextpolicy.planning.placement import Container, Placement
from tests.agent.builders import NODE

PLACEMENT = Placement({NODE: 2000, "node-2": 2000}, (Container("a", "slam", NODE), Container("b", "slam", "node-2")))


def a_policy(**spec):
    task = {"name": "slam", "selector": {"matchLabels": {"app": "slam"}}}
    spec = {"streams": [{"name": "imu", "key": "robot/imu"}], "tasks": [task], **spec}
    return parse({"metadata": {"name": "delivery", "namespace": "robot"}, "spec": spec})


def a_report(**lacks):
    return json.dumps({"missing": {"CFS": [], "Realtime": [], **lacks}}).encode()


def test_an_agents_own_report_is_understood():
    able = Facts(1, limits=True, writable=True, budgets=True, may_schedule=True, sees_processes=True)
    assert realtime_obstacle(json.dumps({"missing": missing(able)}).encode()) == ""
    assert "kubepods" in realtime_obstacle(json.dumps({"missing": missing(Facts(None))}).encode())


@pytest.mark.parametrize("report", [b"", b"{}", b"[]", b'{"missing": 5}', b'{"missing": {}}', b"\xff"])
def test_a_report_that_cannot_be_read_is_an_obstacle(report):
    assert realtime_obstacle(report) == UNREADABLE


def test_a_policy_without_realtime_does_not_care():
    claim = Claim(PLACEMENT)
    assert with_realtime(a_policy(), claim, {}) is claim


def test_nodes_that_are_able_do_realtime():
    claim = with_realtime(a_policy(scheduler="Realtime"), Claim(PLACEMENT), {NODE: "", "node-2": ""})
    assert (claim.placement.fair_only, claim.realtime) == (frozenset(), [])


def test_a_node_that_is_not_falls_back_and_says_why():
    obstacles = {NODE: realtime_obstacle(a_report(Realtime=["no kernel option"]))}
    claim = with_realtime(a_policy(scheduler="Realtime"), Claim(PLACEMENT), obstacles | {"node-2": ""})
    assert claim.placement.fair_only == {NODE}
    assert claim.placement.containers == PLACEMENT.containers
    assert claim.realtime == [f"node {NODE} falls back to CFS: no kernel option"]


def test_a_node_without_agent_says_what_to_install():
    claim = with_realtime(a_policy(scheduler="Realtime"), Claim(PLACEMENT), {NODE: ""})
    assert claim.realtime == [f"node node-2 falls back to CFS: {NO_AGENT}"]


def test_without_fallback_the_node_is_left_alone():
    policy = a_policy(scheduler="Realtime", realtimeFallback="None")
    claim = with_realtime(policy, Claim(PLACEMENT), {NODE: ""})
    assert claim.placement.allocatable.keys() == {NODE}
    assert [container.id for container in claim.placement.containers] == ["a"]
    assert claim.realtime == [f"node node-2 is left alone: {NO_AGENT}"]
