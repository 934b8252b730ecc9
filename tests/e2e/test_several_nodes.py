"""A policy whose tasks run on two nodes: each node's CPU is divided separately, as much as it has.

The second node has no kubelet: nobody runs its pods, so what the API server accepted is what counts there.
"""

from __future__ import annotations

import json
from decimal import Decimal

import pytest

from tests.e2e.cluster import apply, delete, get, run, until
from tests.e2e.robot import IDLE, pod
from tests.node import access

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="adds a node: not to your cluster")

NODE, CORES = "base-computer", 4
LIMITS = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}


def running(name):
    """What a kubelet would say of the pod."""
    container = {
        "name": name,
        "image": "contextpolicy:dev",
        "imageID": "",
        "containerID": f"containerd://{name}",
        "ready": True,
        "started": True,
        "restartCount": 0,
        "resources": LIMITS,
        "state": {"running": {"startedAt": "2026-01-01T00:00:00Z"}},
    }
    conditions = [{"type": kind, "status": "True"} for kind in ("PodScheduled", "Initialized", "Ready")]
    return {"status": {"phase": "Running", "conditions": conditions, "containerStatuses": [container]}}


@pytest.fixture
def node():
    """Another node of four cores, on which the scheduler puts nothing."""
    size = {"cpu": str(CORES), "memory": "8Gi", "pods": "10"}
    status = {"capacity": size, "allocatable": size}
    apply(
        {
            "apiVersion": "v1",
            "kind": "Node",
            "metadata": {"name": NODE},
            "spec": {"unschedulable": True},
            "status": status,
        }
    )
    yield NODE
    run("kubectl", "delete", "node", NODE)


@pytest.fixture
def robot(empty, node):
    """slam and speech run on the robot's node and, under other names, on the other one."""
    empty.start("slam", "speech")
    for task in ("slam", "speech"):
        name = f"{task}-there"
        there = pod(task, empty.namespace, IDLE, LIMITS)
        there["metadata"]["name"], there["spec"]["nodeName"] = name, node
        apply(there)
        said = json.dumps(running(task))
        run("kubectl", "patch", "pod", name, "-n", empty.namespace, "--subresource=status", "--type=merge", "-p", said)
    yield empty
    for task in ("slam", "speech"):
        run("kubectl", "delete", "pod", f"{task}-there", "-n", empty.namespace, "--force", "--grace-period=0")


def limit(robot, name):
    quantity = get("pod", name, robot.namespace)["spec"]["containers"][0]["resources"]["limits"]["cpu"]
    return int(Decimal(quantity.removesuffix("m")) * (1 if quantity.endswith("m") else 1000))


def there(robot):
    return {task: limit(robot, f"{task}-there") for task in ("slam", "speech")}


def names(robot):
    return {node["name"] for node in robot.status()["nodes"]}


def expect_there(robot, **limits):
    until(f"{NODE} has {limits}", lambda: there(robot) == limits or there(robot))


def test_each_node_divides_its_own_capacity(robot):
    robot.policy(enforcement={"transition": "Prompt"})
    robot.expect(slam=500, speech=500)
    expect_there(robot, slam=1500, speech=1500)
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    expect_there(robot, slam=2990, speech=10)
    until("the status shows both", lambda: NODE in (nodes := names(robot)) and len(nodes) == 2)
    delete("ctxp", "robot", robot.namespace)
    robot.expect(slam=500, speech=500)
    expect_there(robot, slam=500, speech=500)
