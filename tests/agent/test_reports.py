"""What the operator makes of the agents' reports."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from contextpolicy.agent.capabilities import NodeFacts, missing, quota_period
from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.cluster.agent_reports import (
    ALL,
    MOST_BYTES,
    MOST_NAMED,
    MOST_REASON,
    MOST_TEXT,
    NO_AGENT,
    UNREADABLE,
    AgentReport,
    Confirmation,
    not_set,
    read_confirmation,
    read_report,
    unwritten,
    with_agents,
    write_confirmation,
)
from contextpolicy.cluster.claims import Claim
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.planning.allocation.placement import Container, Placement
from tests.agent.builders import NODE, SLAM, Tree
from tests.cluster.builders import a_pod
from tests.planning.builders import a_policy, a_stream, a_task

PLACEMENT = Placement({NODE: 2000, "node-2": 2000}, (Container("a", "slam", NODE), Container("b", "slam", "node-2")))


def governing_slam(**spec):
    return a_policy(streams=[a_stream("imu")], tasks=[a_task("slam")], **spec)


ABLE, FAIR, USELESS = AgentReport("", ""), AgentReport("", "no kernel option"), AgentReport("read-only", "read-only")


def test_report_of_an_agent_is_parsed():
    able = NodeFacts(1, limits=True, writable=True, budgets=True, may_schedule=True, sees_processes=True)
    assert read_report(json.dumps({"missing": missing(able)}).encode()) == ABLE
    assert "kubepods" in read_report(json.dumps({"missing": missing(NodeFacts(None))}).encode()).limits


@pytest.mark.parametrize(
    "report", [b"", b"{}", b"[]", b'{"missing": 5}', b'{"missing": {}}', b'{"missing": {"CFS": [5]}}', b"\xff"]
)
def test_unreadable_report_lacks_everything(report):
    assert read_report(report) == AgentReport(UNREADABLE, UNREADABLE)


def test_detected_node_facts_are_parsed(tmp_path):
    tree = Tree(tmp_path / "cgroup", 2, Driver.SYSTEMD)
    group = tree.container(SLAM)
    for one in (group, group.parent):
        tree.limit_file(one).write_text("25000 50000\n")
    found = {"processors": 6, "quotaPeriod": quota_period(tree.layout), "unlimited": "no cpu.max"}
    report = read_report(json.dumps({"missing": missing(NodeFacts(2)), **found}).encode())
    assert (report.processors, report.quota_period, report.unlimited) == (6, 0.05, "no cpu.max")


def test_a_node_that_cannot_limit_is_reported():
    useless = AgentReport("no cpu.max", "no cpu.max", "no cpu.max")
    claim = with_agents(governing_slam(), Claim(PLACEMENT), {NODE: useless, "node-2": ABLE})
    assert claim.unlimited == [f"node {NODE} can't limit CPU time: no cpu.max"]
    assert claim.agents == {"node-2"}


def test_predictions_use_what_the_agents_found():
    report = AgentReport("", "", processors=6, quota_period=0.05)
    placement = with_agents(governing_slam(), Claim(PLACEMENT), {NODE: report}).placement
    assert (placement.processors_of(NODE), placement.processors_of("node-2")) == (6, 2)
    assert placement.quota_periods == {NODE: 0.05}


def test_agents_that_can_write_limits_are_ahead_of_resizes():
    claim = with_agents(governing_slam(), Claim(PLACEMENT), {NODE: FAIR, "node-2": USELESS, "node-3": ABLE})
    assert claim.agents == {NODE}
    assert (claim.placement, claim.realtime) == (replace(PLACEMENT, agents=frozenset({NODE})), [])


def test_capable_nodes_use_realtime():
    claim = with_agents(
        governing_slam(enforcement={"scheduler": "Realtime"}), Claim(PLACEMENT), {NODE: ABLE, "node-2": ABLE}
    )
    assert (claim.placement.fair_only, claim.realtime) == (frozenset(), [])


def test_incapable_node_falls_back_to_cfs_with_a_reason():
    claim = with_agents(
        governing_slam(enforcement={"scheduler": "Realtime"}), Claim(PLACEMENT), {NODE: FAIR, "node-2": ABLE}
    )
    assert claim.placement.fair_only == {NODE}
    assert claim.placement.containers == PLACEMENT.containers
    assert claim.realtime == [f"node {NODE} falls back to CFS: no kernel option"]


def test_a_node_without_agent_says_what_to_install():
    claim = with_agents(governing_slam(enforcement={"scheduler": "Realtime"}), Claim(PLACEMENT), {NODE: ABLE})
    assert claim.realtime == [f"node node-2 falls back to CFS: {NO_AGENT}"]


def test_without_fallback_the_node_is_left_alone():
    policy = governing_slam(enforcement={"scheduler": "Realtime", "realtimeFallback": "None"})
    claim = with_agents(policy, Claim(PLACEMENT), {NODE: ABLE})
    assert claim.placement.allocatable.keys() == {NODE}
    assert [container.id for container in claim.placement.containers] == ["a"]
    assert claim.realtime == [f"node node-2 is left alone: {NO_AGENT}"]


def test_a_confirmation_is_read_as_it_was_written():
    said = Confirmation("lab/robot", (1, 2, 3), {"containerd://a": "Busy"})
    assert read_confirmation(write_confirmation(said)) == said


@pytest.mark.parametrize(("number", "named"), [(MOST_NAMED, MOST_NAMED), (MOST_NAMED + 1, 1)])
def test_confirmation_with_too_many_failures_reports_all(number, named):
    failed = {f"containerd://{n:064}": "OutOfBounds" for n in range(number)}
    payload = write_confirmation(Confirmation("lab/robot", (1, 2, 3), failed))
    said = read_confirmation(payload)
    assert said is not None
    assert (len(said.failed), ALL in said.failed) == (named, named == 1)
    assert len(payload) < 12_000


def test_confirmation_that_no_agent_writes_is_bounded():
    """What fails is logged, and kept until the next plan."""
    said = {"policy": "lab/robot", "stamp": [1, 2, 3], "failed": {"containerd://a": "x" * 1000}}
    read = read_confirmation(json.dumps(said).encode())
    assert read is not None
    assert read.failed == {"containerd://a": "x" * MOST_REASON}
    many = {**said, "failed": dict.fromkeys(map(str, range(MOST_NAMED + 1)), "Busy")}
    assert read_confirmation(json.dumps(many).encode()) is None


def test_failed_containers_are_matched_by_node_and_container_id():
    pods = [view(a_pod("slam")), view(a_pod("speech"))]
    node, known = pods[0].node, pods[0].containers[0].container_id
    assert not_set({node: {known}}, pods) == {"lab/slam/slam"}
    assert not_set({node: {"containerd://before-the-restart"}}, pods) == frozenset()
    assert not_set({"another": {known, ALL}}, pods) == frozenset()
    assert not_set({node: {ALL}}, pods) == {"lab/slam/slam", "lab/speech/speech"}


def test_a_failed_weight_write_is_reported():
    pods = [view(a_pod("slam")), view(a_pod("speech"))]
    failures = {pods[0].node: {pods[0].containers[0].container_id: "Forbidden"}}
    weighted = governing_slam(enforcement={"control": "Weight"})
    reported = f"lab/slam/slam: the agent of node {pods[0].node} can't write its weight: Forbidden"
    assert unwritten(weighted, failures, pods) == [reported]
    assert unwritten(governing_slam(), failures, pods) == []


def test_a_report_that_is_too_long_is_not_read_and_its_texts_are_cut():
    lacks = {"missing": {"CFS": ["x" * MOST_TEXT, "y"], "Realtime": []}}
    assert read_report(json.dumps(lacks).encode()).limits == "x" * MOST_TEXT
    flood = json.dumps({"missing": {"CFS": [], "Realtime": []}, "unlimited": "x" * MOST_BYTES}).encode()
    assert read_report(flood) == AgentReport(UNREADABLE, UNREADABLE)
    assert read_confirmation(write_confirmation(Confirmation("lab/robot", (1, 1, 1), {"x" * MOST_BYTES: ""}))) is None
