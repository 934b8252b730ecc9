"""What several pods weigh together: beside a Guaranteed pod, and as the containers of one task."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.order import order_of
from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.targets import target_cpu
from contextpolicy.actuators.resize.tracked_pod import TrackedPod
from contextpolicy.bus.plan_message import message
from contextpolicy.cluster.agent_reports import AgentReport, with_agents, writing
from contextpolicy.cluster.pods import view
from tests.cluster.builders import NODE, a_pod, cpu
from tests.cluster.claiming import claim
from tests.planning.builders import Story, a_policy, a_stream, a_task

TWO_CORES = {NODE: 2000}


def weighted(*tasks):
    return a_policy(
        streams=[a_stream("imu")], tasks=list(tasks), contexts=[], enforcement={"control": "Weight"}, reserve="0"
    )


def request_of(order, pod):
    target = target_cpu(order, f"lab/{pod.name}/{pod.name}", TrackedPod(PodState(pod)), pod.containers[0], None)
    return target.request or 0


def plan(policy, placement):
    story = Story(policy, placement)
    story.sample("imu", at=1, speed=0)
    return story.last


def test_requests_fit_beside_a_guaranteed_pod_whose_own_never_moves():
    policy = weighted(a_task("slam"), a_task("speech", priority=9), a_task("map"))
    resources = {
        "slam": cpu("1500m", "1500m", ("64Mi", "64Mi")),
        "speech": cpu("10m", "2"),
        "map": cpu("10m", "2"),
    }
    pods = [
        view(a_pod(name, {name: own}, qos="Guaranteed" if name == "slam" else "Burstable"))
        for name, own in resources.items()
    ]
    own = claim([policy], pods, TWO_CORES)[policy.reference]
    order = order_of(policy, own.placement.containers, plan(policy, own.placement).nodes, room=own.room)
    requests = {pod.name: request_of(order, pod) for pod in pods}
    assert requests["slam"] == 1500
    assert requests["speech"] > requests["map"]
    assert sum(requests.values()) <= 2000


@pytest.mark.parametrize("pods", [1, 2, 4])
def test_a_protected_task_weighs_a_core_over_all_its_containers_on_a_node(pods):
    policy = weighted(a_task("guard", protected=True, max="400m"), a_task("slam", priority=100))
    found = [view(a_pod(f"guard-{n}", {"guard": cpu("10m", "100m")}, labels={"app": "guard"})) for n in range(pods)]
    found.append(view(a_pod("slam", {"slam": cpu("10m", "2")})))
    reports = {NODE: AgentReport("", "")}
    own = with_agents(policy, claim([policy], found, TWO_CORES, agents=writing(reports))[policy.reference], reports)
    targets = message(policy, 1, plan(policy, own.placement), own.placement.containers, found)["targets"]
    assert sum(target["weight"] for target in targets if target["task"] == "guard") == pytest.approx(1.0)
