"""Who gets which container, and what the others learn."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.policy.spec import Mode
from contextpolicy.policy.tenants import Tenants
from tests.cluster.builders import NODE, a_pod, cpu
from tests.cluster.claimants import NODES, held, policy_of, views
from tests.cluster.claiming import claim
from tests.planning.builders import a_policy, a_task


def test_each_task_gets_its_container_on_its_node():
    result = claim([policy_of("robot", "slam", "speech")], views("slam", "speech", "other"), NODES)["lab/robot"]
    assert held(result) == {"lab/slam/slam": "slam", "lab/speech/speech": "speech"}
    assert result.placement.allocatable == NODES
    [slam, _] = result.placement.containers
    assert (slam.node, slam.request, slam.memory) == (NODE, 100, 128 << 20)
    assert (result.conflicts, result.obstacles) == ([], {})


def test_a_task_may_name_another_container():
    pod = view(a_pod("slam", {"slam": cpu("1m", "2m"), "map": cpu("1m", "2m")}))
    assert held(claim([policy_of("robot", a_task("slam", container="map"))], [pod], NODES)["lab/robot"]) == {
        "lab/slam/map": "slam"
    }


def test_every_pod_of_a_task_is_claimed():
    pods = [view(a_pod(f"slam-{n}", {"slam": cpu("1m", "2m")}, labels={"app": "slam"})) for n in range(3)]
    assert len(held(claim([policy_of("robot", "slam")], pods, NODES)["lab/robot"])) == 3


@pytest.mark.parametrize(
    "pod",
    [
        a_pod("slam", namespace="elsewhere"),
        a_pod("slam", labels={"app": "other"}),
        a_pod("slam", {"another": cpu("1m", "2m")}),
        a_pod("slam", deletionTimestamp="2026-01-01T00:00:00Z"),
    ],
    ids=["other namespace", "other labels", "no such container", "ending"],
)
def test_pod_that_does_not_match_is_not_claimed(pod):
    assert held(claim([policy_of("robot", "slam")], [view(pod)], NODES)["lab/robot"]) == {}


def test_a_pod_on_a_node_of_unknown_size_waits():
    assert held(claim([policy_of("robot", "slam")], views("slam"), {})["lab/robot"]) == {}


def test_a_guaranteed_pod_has_no_floor():
    pod = view(a_pod("slam", {"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, qos="Guaranteed"))
    [container] = claim([policy_of("robot", "slam")], [pod], NODES)["lab/robot"].placement.containers
    assert container.floor == 10


def test_the_older_policy_keeps_a_contested_container():
    old, young = (
        policy_of("old", "slam", reserve="1"),
        policy_of("young", a_task("mapping", container="slam"), reserve="1"),
    )
    young = replace(young, tasks=(replace(young.tasks[0], selector=old.tasks[0].selector),))
    claims = claim([old, young], views("slam"), NODES)
    assert held(claims["lab/old"]) == {"lab/slam/slam": "slam"}
    assert held(claims["lab/young"]) == {}
    assert claims["lab/young"].conflicts == [
        "lab/slam/slam belongs to task slam of lab/old; task mapping can't claim it too"
    ]
    assert claims["lab/old"].conflicts == []


def test_two_tasks_of_a_policy_cannot_share_a_container():
    both = policy_of("robot", "slam", a_task("mapping", container="slam"))
    both = replace(both, tasks=(both.tasks[0], replace(both.tasks[1], selector=both.tasks[0].selector)))
    result = claim([both], views("slam"), NODES)["lab/robot"]
    assert held(result) == {"lab/slam/slam": "slam"}
    assert result.conflicts == ["lab/slam/slam belongs to slam; task mapping can't claim it too"]


def test_the_younger_policy_divides_what_the_older_one_leaves():
    policies = [policy_of("old", "slam", reserve="500m"), policy_of("young", "speech", reserve="300m")]
    young = claim(policies, views("slam", "speech"), NODES)["lab/young"]
    assert held(young) == {"lab/speech/speech": "speech"}
    assert (young.placement.allocatable, young.placement.left) == (NODES, {NODE: 500})
    assert young.shared == {NODE: f"node {NODE}: lab/old come first and leave 500m of 2000m"}
    assert young.conflicts == []


def test_a_policy_yields_a_node_where_too_little_is_left_for_its_containers():
    policies = [policy_of("old", "slam", reserve="90m"), policy_of("young", "speech")]
    young = claim(policies, views("slam", "speech"), NODES)["lab/young"]
    assert held(young) == {}
    assert young.placement.allocatable == {}
    assert young.conflicts == [
        f"node {NODE}: lab/old come first and leave 90m of 2000m; its containers there need at least 100m"
    ]


@pytest.mark.parametrize(("control", "there"), [("Limit", False), ("Weight", True)])
def test_policy_needs_room_for_requests_only_under_limit(control, there):
    policies = [policy_of("old", "slam", reserve="50m"), policy_of("young", "speech", enforcement={"control": control})]
    assert bool(held(claim(policies, views("slam", "speech"), NODES)["lab/young"])) is there


def test_each_node_has_room_for_its_own_containers():
    far = a_pod("speech-2", {"speech": cpu("1500m", "1600m")}, labels={"app": "speech"})
    far["spec"]["nodeName"] = "robot-2"
    policies = [policy_of("old", "slam", reserve="300m"), policy_of("young", "speech")]
    claims = claim(policies, [*views("slam", "speech"), view(far)], {**NODES, "robot-2": 2000})
    assert claims["lab/young"].placement.allocatable.keys() == {NODE, "robot-2"}


def test_a_policy_yields_only_the_node_that_is_too_small():
    far = a_pod("speech-2", {"speech": cpu("1m", "2m")}, labels={"app": "speech"})
    far["spec"]["nodeName"] = "robot-2"
    policies = [policy_of("old", "slam"), policy_of("young", "speech")]
    claims = claim(policies, [*views("slam", "speech"), view(far)], {**NODES, "robot-2": 1000})
    assert held(claims["lab/young"]) == {"lab/speech-2/speech": "speech"}


@pytest.mark.parametrize("mode", [Mode.DRY_RUN, Mode.PAUSED])
def test_policy_that_does_not_enforce_takes_no_containers(mode):
    old, young = policy_of("old", "slam", mode=mode), policy_of("young", "slam")
    claims = claim([old, young], views("slam"), NODES)
    assert held(claims["lab/old"]) == held(claims["lab/young"]) == {"lab/slam/slam": "slam"}
    assert claims["lab/young"].conflicts == []


def test_obstacle_is_reported_for_its_task_alone():
    pods = [*views("slam"), view(a_pod("speech", {"speech": {}}, qos="BestEffort"))]
    result = claim([policy_of("robot", "slam", "speech")], pods, NODES)["lab/robot"]
    assert held(result) == {"lab/slam/slam": "slam"}
    assert list(result.obstacles) == ["speech"]


def test_a_task_may_accept_the_restarts_that_others_refuse():
    pods = [a_pod("slam"), a_pod("speech")]
    for pod in pods:
        pod["spec"]["containers"][0]["resizePolicy"] = [{"resourceName": "cpu", "restartPolicy": "RestartContainer"}]
    policy = policy_of("robot", a_task("slam", restartOnResize=True), "speech")
    result = claim([policy], [view(pod) for pod in pods], NODES)["lab/robot"]
    assert held(result) == {"lab/slam/slam": "slam"}
    assert list(result.obstacles) == ["speech"]


def test_obstacle_of_one_pod_does_not_affect_its_siblings():
    stuck = a_pod("slam-0", {"slam": cpu("1m", None)}, labels={"app": "slam"})
    result = claim([policy_of("robot", "slam")], [view(stuck), *views("slam")], NODES)["lab/robot"]
    assert held(result) == {"lab/slam/slam": "slam"}
    assert "slam-0/slam has no CPU limit" in result.obstacles["slam"]


@pytest.mark.parametrize(("qos", "resources"), [("Burstable", cpu("10m", None)), ("BestEffort", {})])
def test_with_an_agent_a_pod_without_a_limit_is_claimed(qos, resources):
    pods = [view(a_pod("slam", {"slam": resources}, qos=qos))]
    result = claim([policy_of("robot", "slam")], pods, NODES, agents={NODE})["lab/robot"]
    assert (held(result), result.obstacles) == ({"lab/slam/slam": "slam"}, {})
    assert held(claim([policy_of("robot", "slam")], pods, NODES, agents={"other"})["lab/robot"]) == {}


@pytest.mark.parametrize(
    ("qos", "remedy"),
    [("Guaranteed", "give slam a CPU request below its limit"), ("BestEffort", "give slam a CPU request")],
)
def test_a_pod_that_weights_do_not_reach_is_claimed_and_reported(qos, remedy):
    pods = [view(a_pod("slam", {"slam": {}} if qos == "BestEffort" else None, qos=qos))]
    for control, obstacles in (("Weight", ["slam"]), ("Limit", []), ("Suspend", [])):
        policy = policy_of("robot", "slam", enforcement={"control": control})
        result = claim([policy], pods, NODES, agents={NODE})["lab/robot"]
        assert (held(result), list(result.obstacles)) == ({"lab/slam/slam": "slam"}, obstacles)
        assert all(message.endswith(remedy) for message in result.obstacles.values())


def test_a_container_without_a_limit_counts_as_the_whole_node():
    pods = [view(a_pod("slam", {"slam": cpu("10m", None)})), view(a_pod("speech", namespace="hall"))]
    policies = [policy_of("robot", "slam"), replace(policy_of("other", "speech"), namespace="hall")]
    claims = claim(policies, pods, NODES, tenants=Tenants(), agents={NODE})
    assert claims["lab/robot"].placement.left == {NODE: 1500}


def test_claims_do_not_depend_on_pod_order():
    pods = views("slam", "speech", "nav")
    policy = policy_of("robot", "slam", "speech", "nav")
    assert claim([policy], pods, NODES) == claim([policy], reversed(pods), NODES)


def test_tasks_without_a_running_pod_are_absent():
    policy = policy_of("robot", "slam", "speech", a_task("arm"))
    pods = [*views("slam"), view(a_pod("speech", deletionTimestamp="2026-01-01T00:00:00Z"))]
    assert claim([policy], pods, NODES)["lab/robot"].placement.absent == {"speech", "arm"}


def test_task_claimed_by_another_policy_is_not_absent():
    policies = [policy_of("one", "slam"), policy_of("two", "slam")]
    claims = claim(policies, views("slam"), NODES)
    assert claims["lab/two"].placement.containers == ()
    assert claims["lab/two"].placement.absent == frozenset()


def test_unknown_container_name_is_reported_with_the_names_its_pods_have():
    pods = [view(a_pod("slam-1", {name: cpu("100m", "500m") for name in ("mapper", "driver")}, labels={"app": "slam"}))]
    found = claim([a_policy(tasks=[a_task("slam"), a_task("speech")])], pods, {NODE: 4000})["lab/robot"]
    assert found.misnamed == {
        "slam": "task slam: container: invalid value 'slam': "
        "expected one that its pods have, such as slam-1: driver, mapper"
    }
    assert found.placement.absent == {"slam", "speech"}


def test_a_selector_may_match_pods_without_the_container_beside_one_that_has_it():
    pods = [view(a_pod(name, {name: cpu("100m", "500m")}, labels={"app": "slam"})) for name in ("helper", "slam")]
    found = claim([a_policy(tasks=[a_task("slam")])], pods, {NODE: 4000})["lab/robot"]
    assert (found.misnamed, len(found.placement.containers)) == ({}, 1)


def test_a_pod_that_must_be_left_alone_is_not_claimed():
    doubts = {"uid-slam": "nobody knows what slam had"}
    found = claim([policy_of("robot", "slam", "speech")], views("slam", "speech"), NODES, doubt=doubts.get)["lab/robot"]
    assert (held(found), found.obstacles) == ({"lab/speech/speech": "speech"}, {"slam": "nobody knows what slam had"})


def test_a_claim_names_the_limit_that_another_writer_insists_on_and_plans_as_before():
    policies, pods = [policy_of("robot", "slam", "speech")], views("slam", "speech")
    lost = claim(policies, pods, NODES, left=lambda uid, name: 700 if (uid, name) == ("uid-slam", "slam") else None)
    assert [container.left for container in lost["lab/robot"].placement.containers] == [700, None]
    assert lost["lab/robot"].placement == claim(policies, pods, NODES)["lab/robot"].placement
