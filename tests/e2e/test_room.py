"""Weights as requests beside other pods' requests, by an operator that sees all pods: nothing is ever deferred."""

import json
from itertools import cycle, islice

import pytest

from contextpolicy.cluster.resource_quantities import millicores
from tests.e2e.cluster import apply_definition, delete, get, run, until
from tests.e2e.releases import Release
from tests.e2e.robot import task

MOST = 2000
"""The max of each of the two tasks, in thousandths of a core."""
DRIVER = {"requests": {"cpu": "600m", "memory": "32Mi"}, "limits": {"memory": "64Mi"}}


@pytest.fixture(scope="module")
def robot():
    release = Release("room", 58)
    apply_definition()
    release.install(watchNamespaces="null")
    try:
        with release.sensors() as robot:
            robot.drive(0.0)
            robot.start("slam", "speech")
            tasks = [task(name, max=f"{MOST}m") for name in ("slam", "speech")]
            robot.policy(enforcement={"control": "Weight"}, reserve="0", tasks=tasks)
            yield robot
            delete("ctxp", "robot", robot.namespace)
    finally:
        release.remove()


def requests():
    """What each pod requests, in thousandths of a core."""
    items = json.loads(run("kubectl", "get", "pods", "-A", "-o", "json"))["items"]
    alive = [pod for pod in items if pod["status"].get("phase") not in ("Succeeded", "Failed")]
    return {
        f"{pod['metadata']['namespace']}/{pod['metadata']['name']}": sum(
            millicores(container.get("resources", {}).get("requests", {}).get("cpu")) or 0
            for container in [*pod["spec"]["containers"], *pod["spec"].get("initContainers", [])]
        )
        for pod in alive
    }


def fits(robot):
    """The factor is what the other pods leave, and in each context all requests fit and are in force."""
    node = json.loads(run("kubectl", "get", "nodes", "-o", "json"))["items"][0]
    size = millicores(node["status"]["allocatable"]["cpu"])
    assert size is not None
    own = {f"{robot.namespace}/{name}" for name in ("slam", "speech")}
    left = size - sum(amount for name, amount in requests().items() if name not in own)
    due = round(left / (2 * MOST), 3)

    def factor():
        status = robot.status()
        now = status["nodes"][0].get("requestFactor")
        return (now is not None and abs(now - due) <= 0.001) or f"{now}, not {due}; the status is {status}"

    until("the factor is what other pods leave", factor)
    for speed in islice(cycle([0.3, 0.0]), 6):
        robot.drive(speed)
        wanted = {"slam": (size if speed else size // 2) * due, "speech": 2 if speed else size // 2 * due}
        until(f"requests are {wanted}", lambda wanted=wanted: requested(robot, wanted))
        assert sum(requests().values()) <= size
    assert robot.reported("ResizePending") == []


def requested(robot, wanted):
    """The kubelet has granted what is wanted; the plan keeps 10m for a task that is suspended."""
    statuses = {name: get("pod", name, robot.namespace)["status"]["containerStatuses"][0] for name in wanted}
    now = {name: millicores(status["allocatedResources"]["cpu"]) for name, status in statuses.items()}
    return all(abs(now[name] - amount) <= 0.02 * amount + 6 for name, amount in wanted.items()) or now


def test_new_pods_find_room_for_their_requests(robot):
    robot.start("driver", resources=DRIVER)
    fits(robot)
    robot.stop("driver")
    fits(robot)
