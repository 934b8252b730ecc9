"""CPU weights on the real node (cgroup version 1): the CPU that tasks receive beside other loads."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import time
from pathlib import Path

import pytest
from kubernetes.utils.quantity import parse_quantity

from contextpolicy.agent.weight_units import FILES, of_pod
from tests.e2e.agents import NAMESPACE, group, usage
from tests.e2e.cluster import get, run, until
from tests.e2e.robot import BUSY, Robot, Sensors, task
from tests.node import lifecycle

THREADS = (
    "import hashlib, threading\n"
    "data = bytes(1 << 20)\n"
    "def work():\n"
    "    while True: hashlib.sha256(data)\n"
    "for _ in range(4): threading.Thread(target=work).start()\n"
)
"""Hashing leaves Python's lock: each thread can fill a processor."""
SLAM = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "2", "memory": "64Mi"}}
HOG = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"memory": "64Mi"}}
GUARANTEED = {kind: {"cpu": "200m", "memory": "64Mi"} for kind in ("requests", "limits")}
NODE, BESIDE = 2000, 210
"""The node, and what the pods of `hogs` request of it: so the weights of the tasks add up to the rest."""
PARTS = {"slam": 0.9, "speech": 0.1}
ALL_PODS = Path("/sys/fs/cgroup/cpuacct/kubepods/cpuacct.usage")
SYSTEM = 1024
"""The weight that systemd gives to a slice."""
WINDOW = 8.0
"""Seconds over which CPU time is measured."""
LONG = 190.0
"""Seconds for which weights hold, more than three minutes: the kubelet writes its class groups once a minute."""
ENOUGH = 0.9
"""Of what the weights give a task: processors are shared out one by one."""


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.drive(0.0)
        yield robot


@pytest.fixture
def tasks(robot, agent):
    """Two tasks that take what they get; together they fill the node twice."""
    agent.wait()
    robot.start("slam", "speech", command=["python3", "-c", THREADS], resources=SLAM)
    yield robot
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
    robot.stop("slam", "speech")


@pytest.fixture
def hogs(robot):
    """Other loads: beside the tasks, in the other classes, and outside of Kubernetes."""
    robot.start("beside", command=BUSY, resources=HOG)
    robot.start("best-effort", command=["python3", "-c", THREADS], resources={})
    robot.start("guaranteed", command=BUSY, resources=GUARANTEED)
    with in_system_slice():
        yield
    robot.stop("beside", "best-effort", "guaranteed")


@contextlib.contextmanager
def in_system_slice():
    """Two busy processes in a group beside all pods', with the weight that systemd gives to a slice."""
    folder = Path("/sys/fs/cgroup/cpu/e2e-system.slice")
    folder.mkdir(exist_ok=True)
    (folder / FILES[1]).write_text(str(SYSTEM))
    processes = [multiprocessing.Process(target=_spin, args=(folder / "cgroup.procs",)) for _ in range(2)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join(10)
        until("the group is empty", lambda: not (folder / "cgroup.procs").read_text())
        folder.rmdir()


def _spin(procs):
    procs.write_text(str(os.getpid()))
    while True:
        pass


def entitled():
    """The part of all pods' CPU that slam's weight entitles it to, from the API's requests and the tasks' weights.

    What all pods get beside system.slice, and beside whatever else runs on the machine, is not a policy's to decide.
    """
    own = {name: of_pod(round((NODE - BESIDE) * part), 1) for name, part in PARTS.items()}
    return own["slam"] / (sum(own.values()) + of_pod(10, 1) + of_pod(200, 1) + 2)


def received(robot):
    """The tasks' parts of all pods' CPU."""
    before, began = int(ALL_PODS.read_text()), time.monotonic()
    cores = usage(robot, "slam", "speech", seconds=WINDOW)
    total = (int(ALL_PODS.read_text()) - before) / 1e9 / (time.monotonic() - began)
    return {task: amount / total for task, amount in cores.items()}


def weight(folder):
    """A group's weight in the kernel's unit."""
    return int((folder / FILES[1]).read_text())


def govern(robot, divided=NODE - BESIDE, **more):
    """Slam gets nine times what speech gets, and speech nothing while the robot moves."""
    tasks = [task("slam", priority=9), task("speech", priority=1)]
    robot.policy(reserve="0", enforcement={"control": "Weight"}, tasks=tasks, **more)
    weighted(robot, divided * PARTS["slam"])


def weighted(robot, slam=(NODE - BESIDE) * PARTS["slam"]):
    """Other pods keep what they request: so much is left for slam, in thousandths of a core."""

    def right():
        own = group(robot, "slam").parent
        return weight(own) == of_pod(round(slam), 1) or weight(own)

    until("slam has its weight", right)


def enough(robot):
    """Slam receives what its weight entitles it to."""
    got, due = received(robot), entitled()
    assert got["slam"] >= ENOUGH * due, f"{got} of all pods' CPU, slam is entitled to {due:.2f}"
    return got


@pytest.mark.usefixtures("hogs")
def test_a_task_receives_its_weights_cpu_whatever_the_kubelet_writes(tasks):
    before = received(tasks)["slam"]
    assert before < 0.5 * entitled(), "the test must be able to fail"
    govern(tasks)
    began = time.monotonic()
    got = enough(tasks)
    assert got["speech"] < got["slam"] / 3
    lifecycle.stop("kubelet")
    lifecycle.start("kubelet")
    enough(tasks)
    tasks.start("passer-by")
    enough(tasks)
    tasks.stop("passer-by")
    enough(tasks)
    restarts = tasks.restarts("slam")
    tasks.kill("slam")
    until("slam runs again", lambda: tasks.restarts("slam") > restarts, patience=60)
    weighted(tasks)
    enough(tasks)
    while time.monotonic() - began < LONG:
        enough(tasks)


@pytest.mark.usefixtures("hogs")
def test_quota_written_by_the_api_keeps_the_weights(tasks):
    govern(tasks)
    tasks.drive(0.3)
    tasks.expect(speech=10)
    until("the API has the quota", lambda: tasks.api_limit("speech") == "10m" or tasks.api_limit("speech"))
    time.sleep(2)  # the kubelet writes pod and container once more
    got = enough(tasks)
    assert got["speech"] < 0.02
    tasks.drive(0.0)
    until("the API has the limit back", lambda: tasks.api_limit("speech") == "2" or tasks.api_limit("speech"))
    time.sleep(2)
    got = enough(tasks)
    assert got["speech"] > 0.05


@pytest.mark.usefixtures("hogs")
def test_a_deleted_policy_leaves_every_weight_as_the_api_says(tasks):
    folders = [path for task in ("slam", "speech") for path in (group(tasks, task), group(tasks, task).parent)]
    before = [weight(folder) for folder in folders]
    govern(tasks)
    assert [weight(folder) for folder in folders] != before
    run("kubectl", "delete", "ctxp", "--all", "-n", tasks.namespace, "--timeout=60s")
    until("all weights are back", lambda: (now := [weight(folder) for folder in folders]) == before or now)


def requested_by_others():
    """Thousandths of a core that all pods on the node but the tasks request, whatever namespace they are in."""
    pods = json.loads(run("kubectl", "get", "pods", "-A", "-o", "json"))["items"]
    others = [pod for pod in pods if pod["metadata"]["name"] not in PARTS]
    containers = [container["resources"] for pod in others for container in pod["spec"]["containers"]]
    requests = [resources.get("requests", {}).get("cpu", "0") for resources in containers]
    return round(1000 * sum(parse_quantity(amount) for amount in requests))


@pytest.fixture
def protected(tasks, hogs):  # noqa: ARG001 - what they request is reserved
    """Both tasks would each weigh a core; what all other pods request is reserved, as the operator sees only some."""
    own = [task(name, protected=True) for name in ("slam", "speech")]
    reserve = requested_by_others()
    tasks.policy(reserve=f"{reserve}m", enforcement={"control": "Weight"}, tasks=own)
    weighted(tasks, (NODE - reserve) / 2)
    return tasks


def part_of_all(pod):
    """Of what all pods get, by the kernel's weights: a Guaranteed pod competes with the other classes."""
    return weight(pod) / sum(weight(other.parent) for other in pod.parent.glob(f"*/{FILES[1]}"))


def test_pods_without_a_policy_keep_their_part_of_the_weights(protected):
    """The group of a pod that was deleted may still be there for a while, and weights are whole numbers."""
    pod = group(protected, "guaranteed").parent
    until("the pod has its part", lambda: (part := part_of_all(pod)) >= 0.99 * 200 / NODE or part)


@pytest.mark.xfail(reason="Linux 6.18 gave one busy thread a third of its part (see the threat model)", strict=False)
def test_pods_without_a_policy_receive_their_part(protected):
    """Under full contention."""
    due = part_of_all(group(protected, "guaranteed").parent)
    whole, began = int(ALL_PODS.read_text()), time.monotonic()
    cores = usage(protected, "guaranteed", seconds=WINDOW)
    total = (int(ALL_PODS.read_text()) - whole) / 1e9 / (time.monotonic() - began)
    assert cores["guaranteed"] / total >= ENOUGH * due, f"{cores['guaranteed']} cores of {total}, {due:.3f} is due"


def test_requests_are_unchanged(tasks):
    govern(tasks, divided=NODE)
    tasks.drive(0.3)
    tasks.expect(speech=10)
    tasks.drive(0.0)
    tasks.expect(speech=2000)
    for name in ("slam", "speech"):
        assert get("pod", name, tasks.namespace)["spec"]["containers"][0]["resources"]["requests"]["cpu"] == "10m"
