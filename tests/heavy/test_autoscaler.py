"""A real VerticalPodAutoscaler, with its metrics-server, on the containers of a policy: what each of the two does.

It needs the node: `make heavy` runs it there. The autoscaler looks every 10 s, and so acts as often.
"""

import os
import time

import pytest
from kubernetes.utils.quantity import parse_quantity

from tests.bench.reaction import objects
from tests.e2e.cluster import apply, apply_definition, delete, get, run, until
from tests.e2e.releases import Release
from tests.e2e.robot import BUSY, pod
from tests.node import access, autoscaler

pytestmark = pytest.mark.skipif(
    access.user_cluster() is not None or "KUBECONFIG" not in os.environ, reason="starts programs beside our own node"
)

TASKS = "slam", "speech"
PODS = {task: f"{task}-0" for task in TASKS}
MINUTES = 300.0
"""Seconds in which an autoscaler has seen enough, or has insisted for long enough."""


@pytest.fixture(scope="module")
def autoscaled():
    with autoscaler.running():
        yield


@pytest.fixture(scope="module")
def release(autoscaled):  # noqa: ARG001 - a policy meets it from its first plan on
    one = Release("vpa", 55)
    apply_definition()
    one.install()
    try:
        yield one
    finally:
        one.remove()


@pytest.fixture
def robot(release):
    """Two busy tasks, each a StatefulSet: an autoscaler looks after controllers, not after pods."""
    with release.sensors() as robot:
        apply(*(objects.replicated(pod(task, robot.namespace, BUSY, None)) for task in TASKS))
        for task in TASKS:
            run("kubectl", "rollout", "status", f"statefulset/{task}", "-n", robot.namespace, "--timeout=90s")
        yield robot
        delete("ctxp", "robot", robot.namespace)
        for kind in ("vpa", "statefulset"):
            run("kubectl", "delete", kind, "--all", "-n", robot.namespace, "--timeout=60s")
        until("the pods are gone", lambda: run("kubectl", "get", "pods", "-n", robot.namespace, "-o", "name") == "")


def look_after(robot, task, resource, **policy):
    """Have the autoscaler set requests for one resource of a task, in place."""
    apply(objects.autoscaler(task, robot.namespace, resource, **policy))


def resources(robot, task):
    return get("pod", PODS[task], robot.namespace)["spec"]["containers"][0]["resources"]


def memory(robot):
    """What slam requests, in MiB."""
    return parse_quantity(resources(robot, "slam")["requests"]["memory"]) / 2**20


def govern(robot):
    robot.policy()
    robot.drive(0.3)
    robot.expect(**{"slam-0": 990, "speech-0": 10})


def test_memory_autoscaler_and_policy_work_together(robot):
    """As the README advises: `controlledResources: [memory]`."""
    govern(robot)
    look_after(robot, "slam", "memory", minAllowed={"memory": "100Mi"}, maxAllowed={"memory": "100Mi"})
    until("it gives memory", lambda: memory(robot) == 100 or resources(robot, "slam"), MINUTES)
    for speed, expected in ((0.0, {"slam-0": 500, "speech-0": 500}), (0.3, {"slam-0": 990, "speech-0": 10})):
        robot.drive(speed)
        robot.expect(**expected)
    assert resources(robot, "slam")["requests"]["cpu"] == "10m"
    assert robot.condition("Applied")[0] == "True"
    assert robot.reported("ResizedByOther") == []
    delete("ctxp", "robot", robot.namespace)
    robot.expect(**{"slam-0": 500, "speech-0": 500})
    assert memory(robot) == 100, "it is not ours to put back"
    assert restarts(robot) == [0, 0]


@pytest.mark.parametrize("controlled", ["RequestsAndLimits", "RequestsOnly"])
def test_cpu_autoscaler_is_reverted_until_it_persists(robot, controlled):
    """It raises the request to what it saw used, and the limit in proportion: with 10m and 990m to a hundred cores."""
    govern(robot)
    look_after(robot, "slam", "cpu", controlledValues=controlled)
    changed = "limit" if controlled == "RequestsAndLimits" else "request"
    said = f"{robot.namespace}/slam-0/slam: updater changed its CPU {changed}"
    until("the status names it", lambda: said in (now := robot.condition("Applied"))[1] or now, MINUTES)
    assert "controlledResources: [memory]" in robot.condition("Applied")[1]
    robot.expect(**{"slam-0": 990, "speech-0": 10})

    until(
        "it gets its way",
        lambda: "the operator leaves the change in place" in (now := robot.condition("Applied"))[1] or now,
        MINUTES,
    )
    time.sleep(3 * autoscaler.INTERVAL)
    assert resources(robot, "slam")["requests"]["cpu"] != "10m", "it keeps what it has"
    assert any("retries the plan's value every 10 min" in message for message in robot.reported("ResizedByOther"))

    delete("vpa", "slam", robot.namespace)
    delete("ctxp", "robot", robot.namespace)
    robot.expect(**{"slam-0": 500, "speech-0": 500})
    assert resources(robot, "slam")["requests"]["cpu"] == "10m"
    assert restarts(robot) == [0, 0]


def restarts(robot):
    """An autoscaler in place, and a policy, restart nothing."""
    statuses = [get("pod", name, robot.namespace)["status"]["containerStatuses"][0] for name in PODS.values()]
    return [status["restartCount"] for status in statuses]
