"""What a tenant writes on its pods moves no CPU but its own, and no lie there becomes what is restored."""

import json

import pytest

from tests.e2e.cluster import CommandError, apply, delete, get, run, until
from tests.e2e.robot import IDLE, pod

LIE = {"cpu": "7"}
ORIGINAL = json.dumps({"containers": [{"name": "slam", "resources": {"requests": LIE, "limits": LIE}}]})
PREFIXES = ("contextpolicy.dev", "e2e.contextpolicy.dev", "kopf.zalando.org", "kubectl.kubernetes.io")
NAMES = ("original", "originals", "limits", "resources", "last-applied-configuration", "last-handled-configuration")


@pytest.fixture
def governed_slam(governed):
    """The policy is deleted by each test itself, which has to find everything as it was."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    yield governed
    delete("ctxp", "robot", governed.namespace)


def test_annotations_are_never_read(governed_slam):
    robot = governed_slam
    notes = {f"{prefix}/{name}": ORIGINAL for prefix in PREFIXES for name in NAMES}
    metadata = {"annotations": {**notes, "contextpolicy.dev/padding": "x" * 100_000}}
    patch = json.dumps({"metadata": metadata})
    for task in ("slam", "speech"):
        run("kubectl", "patch", "pod", task, "-n", robot.namespace, "--type=merge", f"-p={patch}")
    robot.drive(0.0)
    robot.expect(slam=500, speech=500)
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    delete("ctxp", "robot", robot.namespace)
    robot.expect(slam=500, speech=500)


def test_pods_with_the_same_labels_in_another_namespace_are_not_ours(governed_slam, empty):
    """A tenant can neither get a share of this robot's CPU nor take it from the robot's own task."""
    stranger = pod("slam", empty.namespace, IDLE, None)
    stranger["metadata"]["labels"]["app.kubernetes.io/managed-by"] = "contextpolicy"
    apply(stranger)
    run("kubectl", "wait", "pod/slam", "-n", empty.namespace, "--for=condition=Ready", "--timeout=60s")
    governed_slam.drive(0.0)
    governed_slam.expect(slam=500, speech=500)
    governed_slam.drive(0.3)
    governed_slam.expect(slam=990, speech=10)
    assert empty.limits("slam") == {"slam": 500}


def forged_container(robot):
    """Slam says that its container is speech's."""
    speech = get("pod", "speech", robot.namespace)["status"]["containerStatuses"][0]
    return {"containerStatuses": [{**_own_status(robot), "containerID": speech["containerID"]}]}


def forged_resources(robot):
    """Slam says that it already has other resources."""
    lie = {"limits": {**LIE, "memory": "64Mi"}, "requests": {"cpu": "10m", "memory": "32Mi"}}
    return {"containerStatuses": [{**_own_status(robot), "resources": lie, "allocatedResources": LIE}]}


def forged_refusal(_robot):
    """Slam says that its resize can't be done."""
    refused = {"type": "PodResizePending", "status": "True", "reason": "Infeasible", "message": "\x1b[31m" * 50}
    return {"conditions": [refused]}


def forged_nothing(_robot):
    """Slam says that it has no containers."""
    return {"containerStatuses": None}


@pytest.mark.parametrize("forge", [forged_container, forged_resources, forged_refusal, forged_nothing])
def test_a_forged_status_moves_nothing_and_is_not_restored(governed_slam, forge):
    """The kubelet puts a status right when it next writes it; until then the lie stands, through a change of plan."""
    robot = governed_slam
    cgroups = {task: robot.container(task) for task in ("slam", "speech")}
    for speed, expected in ((0.0, (500, 500)), (0.3, (990, 10))):
        _forge(robot, forge(robot))
        robot.drive(speed)
        until(f"the kernel enforces {expected}", lambda want=expected: _limits(cgroups) == want or _limits(cgroups))
    _forge(robot, forge(robot))
    delete("ctxp", "robot", robot.namespace)
    until("all is as it was", lambda: _limits(cgroups) == (500, 500) or _limits(cgroups))


def _forge(robot, status):
    """The kubelet may write at the same moment; then there is nothing left to forge."""
    patch = json.dumps({"status": status})
    how = ("--subresource=status", "--type=merge", f"-p={patch}")
    try:
        run("kubectl", "patch", "pod", "slam", "-n", robot.namespace, *how)
    except CommandError as error:
        if "Conflict" not in str(error):
            raise


def _own_status(robot):
    return get("pod", "slam", robot.namespace)["status"]["containerStatuses"][0]


def _limits(cgroups):
    return tuple(round((cgroup.limit() or 0) * 1000) for cgroup in cgroups.values())
