"""What breaks on robots: the last good plan stays in force, and the next sample counts again.

Each story notes what it promises and how long it took; the table is written to build/e2e/faults.md.
"""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.e2e.cluster import delete, run, until
from tests.e2e.conftest import SYSTEM, router
from tests.e2e.robot import BUSY, policy, together
from tests.node import access, components, lifecycle, shell
from timelines.demo.cgroup import find

own_node = pytest.mark.skipif(access.user_cluster() is not None, reason="stops parts of the node: not on yours")

SENSOR = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    while True:
        session.put(sys.argv[2], json.dumps({"gyro": [0, 0, 0.3], "speed": 0.3}))
        time.sleep(float(sys.argv[3]))
"""


@pytest.fixture(autouse=True)
def _supervisor():
    """Start again what has ended, as k3s or systemd would: a scheduler that lost its API server may end itself."""
    for name in () if access.user_cluster() else components.names():
        lifecycle.start(name)


def pods(component):
    labels = f"app.kubernetes.io/component={component}"
    found = json.loads(run("kubectl", "get", "pods", "-n", SYSTEM, "-l", labels, "-o", "json"))
    return [pod for pod in found["items"] if "deletionTimestamp" not in pod["metadata"]]


def kill(component):
    """SIGKILL every process of the component's pod; returns how often it had restarted before."""
    status = pods(component)[0]["status"]["containerStatuses"][0]
    cgroup = find(status["containerID"])
    assert cgroup is not None
    for pid in cgroup.processes():
        os.kill(pid, signal.SIGKILL)
    return status["restartCount"]


def await_restart(component, restarts):
    def ready():
        status = pods(component)[0]["status"]["containerStatuses"][0]
        return status["ready"] and status["restartCount"] > restarts

    until(f"{component} is back", ready, patience=180)


def test_operator_killed_while_a_context_holds(governed, faults):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    with faults("operator killed (SIGKILL)", "limits stay, originals are known, the next sample counts") as seen:
        await_restart("operator", kill("operator"))
        assert governed.limits("slam", "speech") == {"slam": 990, "speech": 10}
        seen.back()
        governed.drive(0.0)
        governed.expect(slam=500, speech=500)
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)


def test_operator_killed_in_a_storm(governed, faults):
    """Contexts flip every 20 ms while it dies: limits never sum above N, and the newest plan wins in the end."""
    governed.policy(enforcement={"transition": "Strict"})
    cgroups = {task: governed.container(task) for task in ("slam", "speech")}
    with faults("operator killed in a storm of contexts", "limits never sum above N, the newest plan wins") as seen:
        restarts, sums = None, []
        for flip, speed in enumerate(itertools.islice(itertools.cycle([0.3, 0.0]), 100)):
            governed.drive(speed)
            if flip == 50:
                restarts = kill("operator")
            time.sleep(0.02)
            if limits := together(cgroups):
                sums.append(sum(limits.values()))
        assert max(sums) <= 1000
        governed.drive(0.3)
        await_restart("operator", restarts)
        seen.back()
        governed.expect(slam=990, speech=10)


def test_router_gone_and_back(governed, faults):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    with faults("Zenoh router killed", "sessions reconnect, the next sample counts") as seen:
        kill("router")
        seen.back()
        governed.drive(0.0)
        governed.expect(slam=500, speech=500)


def routes(pid):
    """Whether it is the process that routes."""
    return b"--restarts=" in Path(f"/proc/{pid}/cmdline").read_bytes()


def kill_router():
    """SIGKILL the process that routes, not its supervisor."""
    cgroup = find(pods("router")[0]["status"]["containerStatuses"][0]["containerID"])
    assert cgroup is not None
    [router] = filter(routes, cgroup.processes())
    os.kill(router, signal.SIGKILL)


def test_router_killed_again_and_again(governed, faults):
    """A kubelet would wait longer each time, up to 5 min."""
    times = int(os.environ.get("KILLS", "6"))
    restarts = pods("router")[0]["status"]["containerStatuses"][0]["restartCount"]
    slowest = 0.0
    with faults(
        f"Zenoh router's process killed {times} times in a row", "each time the next sample counts within 2 s"
    ) as seen:
        for speed, limits in itertools.islice(itertools.cycle(STATES), times):
            kill_router()
            seen.back()
            governed.drive(speed)
            governed.expect(**limits)
            slowest = max(slowest, time.monotonic() - seen.recovering)
    assert slowest < 2.0 * shell.PATIENCE
    assert pods("router")[0]["status"]["containerStatuses"][0]["restartCount"] == restarts, "the supervisor starts it"


STATES = ((0.3, {"slam": 990, "speech": 10}), (0.0, {"slam": 500, "speech": 500}))
PARTS = {
    **{f"{name} stopped and started": (name,) for name in ("apiserver", "kubelet", "containerd")},
    "all of k3s restarted": components.names(),
}
"""k3s's one process is all of these, and its API takes the next plan before its kubelet is back."""


@own_node
@pytest.mark.parametrize("fault", PARTS)
def test_parts_of_the_node_gone_and_back(governed, faults, fault):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    cgroups = [governed.container("slam"), governed.container("speech")]
    with faults(fault, "the last good plan stays, then the newest is in force") as seen:
        for part in reversed(PARTS[fault]):
            lifecycle.stop(part)
        try:
            governed.drive(0.0)
            assert [round(cgroup.limit() * 1000) for cgroup in cgroups] == [990, 10]
        finally:
            for part in PARTS[fault]:
                lifecycle.start(part)
        seen.back()
        until("the newest plan is in force", lambda: [round(c.limit() * 1000) for c in cgroups] == [500, 500], 180)


@own_node
def test_contexts_change_while_the_kubelet_starts(governed, faults):
    """It serves before it has listed its pods, and what came until then it would look at after 30 s only."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    with faults("contexts change while the kubelet starts", "the newest plan wins") as seen:
        lifecycle.stop("kubelet")
        try:
            governed.drive(0.0)
            until("the API has the next plan", lambda: governed.api_limit("slam") == "500m")
        finally:
            lifecycle.start("kubelet")
        governed.drive(0.3)
        until("the API has the plan before", lambda: governed.api_limit("slam") == "990m")
        seen.back()
        governed.drive(0.0)
        governed.expect(slam=500, speech=500)


def test_frozen_sensor(governed, faults):
    """SIGSTOP: the sensor's session stays open, only its samples are missing."""
    governed.sensors.read(f"{governed.namespace}/imu", None)
    blind = {"name": "blind", "tasks": {"slam": {"weight": 1}, "speech": {"weight": 3}}}
    governed.policy(contexts=[*policy("")["spec"]["contexts"], blind], fallback="blind")
    with sensor(governed, 0.02) as process:
        governed.expect(slam=990, speech=10)
        with faults("sensor frozen (SIGSTOP)", "silent after staleAfter, the fallback context holds") as seen:
            process.send_signal(signal.SIGSTOP)
            seen.back()
            governed.expect(slam=250, speech=750)
            until("the status shows it", lambda: governed.condition("StreamsHealthy")[0] == "False")
            silent = f"stream imu ({governed.namespace}/imu) is silent"
            assert silent in governed.condition("StreamsHealthy")[1]
            process.send_signal(signal.SIGCONT)
            governed.expect(slam=990, speech=10)


def test_slow_sensor(governed, faults):
    """Whatever else the node does, a sample is less late than staleAfter allows for."""
    governed.sensors.read(f"{governed.namespace}/imu", None)
    governed.policy(streams=[{"name": "imu", "key": f"{governed.namespace}/imu", "staleAfter": "20s"}])
    with (
        sensor(governed, 2.0),
        faults("sensor slow, but within staleAfter", "its context holds and the stream is healthy") as seen,
    ):
        seen.back()
        governed.expect(slam=990, speech=10)
        until("the stream is healthy", lambda: governed.condition("StreamsHealthy")[0] == "True")
        time.sleep(5)
        assert governed.limits("slam", "speech") == {"slam": 990, "speech": 10}
        assert governed.condition("StreamsHealthy")[0] == "True"


def test_node_saturated_by_the_tasks_themselves(governed, faults):
    governed.stop("slam", "speech")
    governed.start("slam", "speech", command=BUSY)
    try:
        with faults("node saturated by the tasks", "contexts still change limits") as seen:
            governed.drive(0.3)
            seen.back()
            governed.expect(slam=990, speech=10)
            governed.drive(0.0)
            governed.expect(slam=500, speech=500)
    finally:
        governed.stop("slam", "speech")
        governed.start("slam", "speech")


def test_pods_deleted_and_created_under_load(governed, faults):
    """Busy pods are replaced while contexts change."""
    governed.stop("slam", "speech")
    governed.start("slam", "speech", command=BUSY)
    try:
        with faults("pods deleted and created under load", "a new pod gets its share, the others keep theirs") as seen:
            for name, speed in (("slam", 0.3), ("speech", 0.0), ("slam", 0.0), ("speech", 0.3)):
                governed.drive(speed)
                governed.stop(name)
                governed.start(name, command=BUSY)
            seen.back()
            governed.expect(slam=990, speech=10)
    finally:
        governed.stop("slam", "speech")
        governed.start("slam", "speech")


class sensor:  # noqa: N801 - used as a context manager only
    """A sensor in a process of its own that sees the robot move."""

    def __init__(self, robot, interval):
        key = f"{robot.namespace}/imu"
        self.argv = [sys.executable, "-c", SENSOR, router(), key, str(interval)]

    def __enter__(self):
        self.process = subprocess.Popen(self.argv)
        return self.process

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait(timeout=10)
