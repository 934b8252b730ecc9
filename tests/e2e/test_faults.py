"""What breaks on robots: the last good plan stays in force, and the next sample counts again."""

import json
import os
import signal

import pytest

from tests.cluster import access, lifecycle
from tests.e2e.cluster import delete, run, until
from tests.e2e.conftest import SYSTEM
from timelines.demo.cgroup import find

own_node = pytest.mark.skipif(
    access.user_cluster() is not None, reason="stops parts of the node; not on a user's cluster"
)


def pods(component):
    found = json.loads(
        run("kubectl", "get", "pods", "-n", SYSTEM, "-l", f"app.kubernetes.io/component={component}", "-o", "json")
    )
    return [pod for pod in found["items"] if "deletionTimestamp" not in pod["metadata"]]


def kill(component):
    """SIGKILL every process of the component's pod."""
    status = pods(component)[0]["status"]["containerStatuses"][0]
    cgroup = find(status["containerID"])
    assert cgroup is not None
    for pid in cgroup.processes():
        os.kill(pid, signal.SIGKILL)
    restarts = status["restartCount"]
    until(f"{component} is back", lambda: ready(component, restarts), patience=90)


def ready(component, restarts):
    status = pods(component)[0]["status"]["containerStatuses"][0]
    return status["ready"] and status["restartCount"] > restarts


def test_operator_killed_while_a_context_holds(governed):
    """Nothing is restored or moved by the restart, and nothing is forgotten: deleting still restores."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    kill("operator")
    assert governed.limits("slam", "speech") == {"slam": 990, "speech": 10}
    governed.drive(0.0)
    governed.expect(slam=500, speech=500)
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)


def test_router_gone_and_back(governed):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    kill("router")
    governed.drive(0.0)
    governed.expect(slam=500, speech=500)


@own_node
@pytest.mark.parametrize("component", ["apiserver", "kubelet", "containerd"])
def test_part_of_the_node_gone_and_back(governed, component):
    """While it is gone the kernel enforces the last good plan; when it is back, the newest plan."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    cgroups = [governed.container("slam"), governed.container("speech")]
    lifecycle.stop(component)
    try:
        governed.drive(0.0)
        assert [round(cgroup.limit() * 1000) for cgroup in cgroups] == [990, 10]
    finally:
        lifecycle.start(component)
    until("the kernel enforces the newest plan", lambda: [round(c.limit() * 1000) for c in cgroups] == [500, 500], 60)
