"""What a suspended task keeps on the real node, with the agent: pods with probes, and pods that no resize can cap."""

import time

import pytest

from tests.e2e.agents import NAMESPACE
from tests.e2e.cluster import apply, get, run, until
from tests.e2e.robot import IDLE, Robot, Sensors, pod, task

SLOW_ANSWER = ["python3", "-c", "import email, json, ssl"]
"""A tenth of a second of CPU: ten seconds for a container with 10m."""
NO_LIMIT = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"memory": "64Mi"}}
BIG_REQUEST = {"requests": {"cpu": "100m", "memory": "32Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}
PROBED = 12.0
"""Seconds: three times as long as the kubelet takes to restart what does not answer."""
CONTROLS = ("Suspend", "Weight", "Limit")


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.drive(0.0)
        robot.start("slam")
        yield robot
        robot.stop("slam")


@pytest.fixture
def standing(robot, agent):
    agent.wait()
    robot.drive(0.0)
    robot.stop("speech")
    yield robot
    robot.drive(0.0)
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
    robot.stop("speech")


def start_probed(robot):
    """A pod whose kubelet asks every second, and waits for two."""
    probed = pod("speech", robot.namespace, IDLE, None)
    times = {"periodSeconds": 1, "timeoutSeconds": 2, "failureThreshold": 2}
    probed["spec"]["containers"][0]["livenessProbe"] = {"exec": {"command": SLOW_ANSWER}, **times}
    apply(probed)
    run("kubectl", "wait", "pod/speech", "-n", robot.namespace, "--for=condition=Ready", "--timeout=60s")


def test_slow_liveness_probe_restarts_a_suspended_task_with_a_warning(standing):
    start_probed(standing)
    standing.policy(enforcement={"control": "Weight"})
    warned = "speech/speech has a livenessProbe and only 10m while it is suspended"
    until("an Event warns", lambda: any(warned in message for message in standing.reported("LivenessProbe")))
    assert standing.restarts("speech") == 0
    standing.drive(0.3)
    until("the kubelet has restarted it", lambda: standing.restarts("speech") > 0)
    standing.expect(speech=10)


def test_a_task_that_keeps_enough_for_its_probe_is_not_restarted(standing):
    start_probed(standing)
    standing.policy(enforcement={"control": "Weight"}, tasks=[task("slam"), task("speech", suspendedCpu="300m")])
    standing.drive(0.3)
    standing.expect(speech=300)
    time.sleep(PROBED)
    assert standing.restarts("speech") == 0
    assert standing.reported("LivenessProbe") == []


@pytest.mark.parametrize("control", CONTROLS)
def test_a_task_without_a_limit_is_suspended_by_quota_and_restored_to_none(standing, control):
    """0 stands for no limit."""
    standing.start("speech", resources=NO_LIMIT)
    standing.policy(enforcement={"control": control})
    for _ in range(2):
        standing.drive(0.3)
        standing.expect(speech=10)
        standing.drive(0.0)
        standing.expect(speech=500 if control == "Limit" else 0)
    standing.drive(0.3)
    standing.expect(speech=10)
    assert resources(standing) == NO_LIMIT, "the API could not take a limit away again"
    run("kubectl", "delete", "ctxp", "--all", "-n", standing.namespace, "--timeout=60s")
    standing.expect(speech=0)
    assert resources(standing) == NO_LIMIT


@pytest.mark.parametrize("control", CONTROLS)
def test_a_pod_with_a_limit_of_its_own_keeps_it(standing, control):
    """Its container has none, so the kubelet gives it the pod's; a share of 500m would be more than that."""
    pooled = pod("speech", standing.namespace, IDLE, NO_LIMIT)
    pooled["spec"]["resources"] = {"requests": {"cpu": "10m"}, "limits": {"cpu": "400m"}}
    apply(pooled)
    run("kubectl", "wait", "pod/speech", "-n", standing.namespace, "--for=condition=Ready", "--timeout=60s")
    standing.expect(speech=400)
    assert pod_limit(standing) == 400
    standing.policy(enforcement={"control": control})
    for _ in range(2):
        standing.drive(0.3)
        standing.expect(speech=10)
        assert pod_limit(standing) == 400
        standing.drive(0.0)
        standing.expect(speech=400)
        assert pod_limit(standing) == 400
    standing.drive(0.3)
    standing.expect(speech=10)
    run("kubectl", "delete", "ctxp", "--all", "-n", standing.namespace, "--timeout=60s")
    standing.expect(speech=400)
    assert pod_limit(standing) == 400


def pod_limit(robot):
    """What the kernel enforces for speech's pod as a whole, in thousandths of a core."""
    cgroup = robot.container("speech")
    return int((cgroup.quota_file.parent.parent / cgroup.quota_file.name).read_text().split()[0]) // 100


@pytest.mark.parametrize("control", CONTROLS)
def test_agent_suspends_below_a_request_the_api_cannot_undercut(standing, control):
    """What the kubelet writes for the API is overwritten again."""
    standing.start("speech", resources=BIG_REQUEST)
    standing.policy(enforcement={"control": control})
    standing.drive(0.3)
    until("the API has the least that it can", lambda: standing.api_limit("speech") == "100m")
    time.sleep(2)  # the kubelet writes it
    standing.expect(speech=10)
    standing.drive(0.0)
    until("the API has the limit back", lambda: standing.api_limit("speech") == "500m")
    standing.expect(speech=500)
    assert resources(standing)["requests"]["cpu"] == "100m"


def resources(robot):
    return get("pod", "speech", robot.namespace)["spec"]["containers"][0]["resources"]
