"""What a robot's pods get, seen in the files that the kernel, systemd and the kubelet share."""

import os
import signal
import time

import pytest

from contextpolicy.agent.cgroup_paths import CgroupPaths, Driver, find_cgroups
from contextpolicy.agent.weight_units import of_container, of_pod
from tests.e2e.cluster import until
from tests.e2e.robot import task
from tests.vm.chart import NAMESPACE, ROBOT
from tests.vm.inside import api
from tests.vm.inside.files import ROOT, container_id, limit, scope, systemctl, weight
from tests.vm.inside.robot import (
    MOVING,
    STANDING,
    TASKS,
    agreed,
    api_limits,
    condition,
    drive,
    govern,
    in_force,
    let_go,
    resizes_refused,
    start,
)

ORIGINAL = {"slam": 500, "speech": 500}
OTHER = "default"
CLASSES = {
    "Burstable": None,
    "Guaranteed": {name: {"cpu": "100m", "memory": "64Mi"} for name in ("requests", "limits")},
    "BestEffort": {},
}


def test_a_resize_reaches_cpu_max():
    start("pod", namespace=OTHER)
    group = scope("pod", OTHER)
    assert limit(group) == "50000 100000"
    assert (group / "memory.swap.max").read_text().strip() not in {"0", "max"}, "it may swap, which forbids no resize"
    api.resize("pod", OTHER, limits={"cpu": "250m"})
    until("cpu.max follows", lambda: limit(group) == "25000 100000" or limit(group))
    until("the pod's follows", lambda: limit(group.parent) == "25000 100000" or limit(group.parent))
    assert systemctl("show", "--property=CPUQuotaPerSecUSec", "--value", group.name) == "250ms"


@pytest.mark.parametrize("qos", CLASSES)
def test_every_class_of_pods_is_where_the_agent_looks_for_it(qos):
    start(qos.lower(), namespace=OTHER, resources=CLASSES[qos])
    pod = api.get("pods", qos.lower(), OTHER)
    assert pod["status"]["qosClass"] == qos
    found = find_cgroups(ROOT)
    assert found == CgroupPaths(ROOT, 2, Driver.SYSTEMD)
    group = found.container(qos, pod["metadata"]["uid"], container_id(qos.lower(), OTHER))
    assert group == scope(qos.lower(), OTHER)
    assert [systemctl("is-active", unit.name) for unit in (group, group.parent)] == ["active", "active"]
    api.delete("pods", qos.lower(), OTHER)


@pytest.fixture
def ahead(governed):
    """The agent has written what the robot needs while it moves, and the API can't follow."""
    with resizes_refused():
        drive(governed, 0.3)
        in_force(**MOVING)
        assert api_limits() == dict.fromkeys(TASKS, "200m")
        yield governed


def test_the_agent_is_ahead_of_the_resize_which_agrees(governed):
    with resizes_refused():
        drive(governed, 0.3)
        in_force(**MOVING)
        assert api_limits() == dict.fromkeys(TASKS, "200m")
    agreed(**MOVING)


@pytest.mark.usefixtures("ahead")
def test_agent_limits_survive_a_systemd_reload():
    systemctl("daemon-reload")
    time.sleep(5)
    in_force(**MOVING)


@pytest.mark.usefixtures("ahead")
def test_agent_limits_survive_set_property():
    group = scope("slam", ROBOT)
    for unit in (group, group.parent):
        systemctl("set-property", "--runtime", unit.name, "IOAccounting=yes", "CPUWeight=50")
        until("systemd has written it", lambda unit=unit: weight(unit) == 50 or weight(unit))
        time.sleep(2)
        in_force(**MOVING)
    assert limit(group.parent) == "39000 100000"


@pytest.mark.usefixtures("ahead")
def test_a_killed_agent_restores_its_limits():
    [agent] = api.items("pods", NAMESPACE, **{"app.kubernetes.io/component": "agent"})
    name = agent["metadata"]["name"]
    restarts = container(name)["restartCount"]
    for process in (scope(name, NAMESPACE) / "cgroup.procs").read_text().split():
        os.kill(int(process), signal.SIGKILL)
    until("the agent is back", lambda: container(name)["restartCount"] > restarts and container(name)["ready"])
    in_force(**MOVING)


def container(pod):
    """The status of a pod's container."""
    return api.get("pods", pod, NAMESPACE)["status"]["containerStatuses"][0]


def test_deleting_the_policy_restores_limits_despite_refused_resizes(governed):
    with resizes_refused():
        drive(governed, 0.3)
        in_force(**MOVING)
        api.delete("contextpolicy.dev/v1alpha1/contextpolicies", "robot", ROBOT)
        in_force(**ORIGINAL)
    agreed(**ORIGINAL)


def test_confirmed_resizes_survive_a_systemd_reload(governed):
    drive(governed, 0.3)
    agreed(**MOVING)
    systemctl("daemon-reload")
    time.sleep(5)
    in_force(**MOVING)
    let_go()
    agreed(**ORIGINAL)


def weights(name):
    """Of a task's container, its pod, and the pod's class."""
    group = scope(name, ROBOT)
    return [weight(folder) for folder in (group, group.parent, group.parent.parent)]


def pods_of_the_class():
    group = scope(TASKS[0], ROBOT).parent.parent
    return sum(weight(pod) for pod in group.iterdir() if pod.name.endswith(".slice"))


def weighted(**shares):
    """Every level has what the shares mean, and the class the sum of its pods."""
    wanted = {name: [of_container(cores, 2), of_pod(cores, 2)] for name, cores in shares.items()}

    def right():
        now = {name: weights(name) for name in shares}
        summed = {found[2] for found in now.values()} == {pods_of_the_class()}
        return ({name: found[:2] for name, found in now.items()} == wanted and summed) or (now, pods_of_the_class())

    until(f"the weights mean {shares}", right)


def test_weights_are_written_at_every_level_and_restored(sensors):
    before = {name: weights(name)[:2] for name in TASKS}
    requests = {name: api.get("pods", name, ROBOT)["spec"]["containers"][0]["resources"]["requests"] for name in TASKS}
    drive(sensors, 0.0)
    govern(enforcement={"control": "Weight"})
    weighted(**STANDING)
    drive(sensors, 0.3)
    weighted(slam=390, speech=0)
    in_force(slam=500, speech=10)
    systemctl("daemon-reload")
    time.sleep(65)  # the kubelet has written its classes since
    weighted(slam=390, speech=0)
    assert {
        name: api.get("pods", name, ROBOT)["spec"]["containers"][0]["resources"]["requests"] for name in TASKS
    } == requests
    let_go()
    until("the weights are as they were", lambda: {name: weights(name)[:2] for name in TASKS} == before)


def test_unsupported_realtime_names_the_remedy(sensors):
    drive(sensors, 0.0)
    govern(enforcement={"scheduler": "Realtime"})
    wanted = "cgroup v2 has no realtime budgets (cpu.rt.max) in this kernel: boot with cgroup v1"

    def reported():
        status, message = condition("Realtime")
        return (status == "False" and wanted in message and "falls back to CFS" in message) or (status, message)

    until("the policy's condition says why", reported)
    drive(sensors, 0.3)
    in_force(**MOVING)
    let_go()


def test_the_machine_is_left_governed_for_the_reboot(sensors):
    drive(sensors, None)
    govern(tasks=[task("slam", priority=3), task("speech")])
    agreed(slam=300, speech=100)
