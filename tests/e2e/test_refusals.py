"""What the API refuses, and what the kubelet defers: reported with a remedy, and applied once possible."""

import contextlib
import json

import pytest

from tests.e2e.cluster import NO_RESIZES, apply, delete, get, resizes_refused, run, until
from tests.e2e.robot import IDLE, pod, task
from tests.node import access, layout, lifecycle

GUARANTEED = {"requests": {"cpu": "500m", "memory": "64Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}

own_node = pytest.mark.skipif(access.user_cluster() is not None, reason="writes files of the node: not of yours")


@pytest.fixture
def robot(empty):
    return empty


def bound(kind, namespace, **spec):
    apply({"apiVersion": "v1", "kind": kind, "metadata": {"name": "small", "namespace": namespace}, "spec": spec})


def test_refusing_quota_is_reported_and_retried(robot):
    """Nothing on the pod changes when a quota is raised, so only asking again finds it out."""
    robot.start("slam", "speech")
    robot.policy()
    robot.expect(slam=500, speech=500)
    bound("ResourceQuota", robot.namespace, hard={"limits.cpu": "700m"})
    until("the quota counts", lambda: "used" in get("resourcequota", "small", robot.namespace).get("status", {}))
    robot.drive(0.3)
    robot.expect(slam=500, speech=10)
    until("the status says why", lambda: "exceeded quota: small" in robot.condition("Applied")[1])
    assert "raise the ResourceQuota or lower the task's max" in robot.condition("Applied")[1]
    assert any("exceeded quota: small" in message for message in robot.reported("ResizeFailed"))
    bound("ResourceQuota", robot.namespace, hard={"limits.cpu": "2"})
    robot.expect(slam=990, speech=10)
    until("the status is well again", lambda: (now := robot.condition("Applied"))[0] == "True" or now)


def test_limit_range_that_refuses_is_reported(robot):
    robot.start("slam", "speech")
    robot.policy()
    robot.expect(slam=500, speech=500)
    bound("LimitRange", robot.namespace, limits=[{"type": "Container", "max": {"cpu": "600m"}}])
    robot.drive(0.3)
    robot.expect(slam=500, speech=10)
    until("the status says why", lambda: "maximum cpu usage per Container is 600m" in robot.condition("Applied")[1])
    assert "widen the LimitRange" in robot.condition("Applied")[1]
    delete("limitrange", "small", robot.namespace)
    robot.expect(slam=990, speech=10)
    until("the status is well again", lambda: (now := robot.condition("Applied"))[0] == "True" or now)


def test_refused_restore_reports_what_it_waits_for(robot):
    robot.start("slam", "speech")
    robot.policy()
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    with resizes_refused(robot.namespace, "slam"):
        run("kubectl", "delete", "ctxp", "robot", "-n", robot.namespace, "--wait=false")
        until("the status says why", lambda: NO_RESIZES in robot.condition("Applied")[1])
        assert "without restoring them, remove its finalizer" in robot.condition("Applied")[1]
        until("an Event says why", lambda: any(NO_RESIZES in message for message in robot.reported("RestoreFailed")))
    robot.expect(slam=500, speech=500)
    delete("ctxp", "robot", robot.namespace)


def allocatable():
    [node] = json.loads(run("kubectl", "get", "nodes", "-o", "json"))["items"]
    return 1000 * int(node["status"]["allocatable"]["cpu"])


def requested():
    """The CPU requests of all that runs on the node, in thousandths of a core."""
    total = 0
    for found in json.loads(run("kubectl", "get", "pods", "-A", "-o", "json"))["items"]:
        if found["status"].get("phase") in ("Pending", "Running"):
            amounts = [c["resources"].get("requests", {}).get("cpu", "0") for c in found["spec"]["containers"]]
            total += sum(int(cpu[:-1]) if cpu.endswith("m") else 1000 * int(cpu) for cpu in amounts)
    return total


def test_deferred_resize_is_reported_and_carried_out_when_there_is_room(robot):
    """A Guaranteed pod's request moves with its limit, and another pod has requested what is left of the node."""
    robot.start("slam", resources=GUARANTEED)
    robot.start("speech")
    robot.start("hog", resources={"requests": {"cpu": f"{allocatable() - requested() - 100}m"}})
    robot.policy()
    robot.drive(0.3)
    until("the kubelet defers it", lambda: "slam: Deferred: " in robot.condition("Applied")[1])
    assert "lower the requests of its pods or the task's max" in robot.condition("Applied")[1]
    assert any("slam: Deferred: " in message for message in robot.reported("ResizePending"))
    robot.expect(slam=500, speech=10)
    robot.stop("hog")
    robot.expect(slam=990, speech=10)
    until("the status is well again", lambda: (now := robot.condition("Applied"))[0] == "True" or now)


def test_resize_beyond_the_node_is_reported_until_the_plan_is_within_it(robot):
    """The requests of all containers of a pod count, and the API refuses what the node does not have."""
    pair = pod("slam", robot.namespace, IDLE, GUARANTEED)
    size = {"cpu": "100m", "memory": "64Mi"}
    container = pair["spec"]["containers"][0]
    pair["spec"]["containers"].append({**container, "name": "other", "resources": {"requests": size, "limits": size}})
    apply(pair)
    robot.start("speech")
    run("kubectl", "wait", "pod/slam", "-n", robot.namespace, "--for=condition=Ready", "--timeout=60s")
    robot.policy(reserve="50m")
    robot.drive(0.3)
    until(
        "the status says why",
        lambda: "enough allocatable resources" in (now := robot.condition("Applied"))[1] or now,
    )
    assert "raise the policy's reserve or lower the task's max" in robot.condition("Applied")[1]
    robot.policy(reserve="50m", tasks=[task("slam", container="slam", max="550m"), task("speech")])
    until("the plan is within it", lambda: robot.api_limit("slam") == "550m")
    until("the status is well again", lambda: (now := robot.condition("Applied"))[0] == "True" or now)


@contextlib.contextmanager
def cpu_manager_policy(policy, **settings):
    """The kubelet with this CPU manager; what the other one noted it would not start with."""
    file, checkpoint = layout.CONFIG / "kubelet.json", layout.ROOT / "kubelet" / "cpu_manager_state"
    usual = file.read_text()

    def restart(text):
        lifecycle.stop("kubelet")
        file.write_text(text)
        checkpoint.unlink(missing_ok=True)  # a kubelet that failed to start has written none
        lifecycle.start("kubelet")

    try:
        restart(json.dumps({**json.loads(usual), "cpuManagerPolicy": policy, **settings}))
        yield
    finally:
        restart(usual)


@own_node
def test_infeasible_resize_is_reported_until_the_plan_does_not_need_it(robot):
    """A kubelet that gives whole processors away resizes no Guaranteed pod, whatever it asks for."""
    with cpu_manager_policy("static", kubeReserved={"cpu": "1m"}):
        robot.start("slam", resources=GUARANTEED)
        robot.start("speech")
        robot.policy(reserve="999m")
        robot.expect(slam=500, speech=500)
        robot.drive(0.3)
        until("the kubelet refuses it", lambda: "slam: Infeasible: " in robot.condition("Applied")[1])
        assert "so that it is Burstable, or leave it out of the policy" in robot.condition("Applied")[1]
        assert any("slam: Infeasible: " in message for message in robot.reported("ResizePending"))
        robot.expect(slam=500, speech=10)
        robot.drive(0.0)
        robot.expect(slam=500, speech=500)
        until("the status is well again", lambda: (now := robot.condition("Applied"))[0] == "True" or now)


@own_node
def test_static_pod_is_reported_and_left_alone(robot):
    name, manifest = f"speech-{layout.NODE_NAME}", layout.MANIFESTS / "e2e-speech.json"
    robot.start("slam")
    robot.policy()
    manifest.write_text(json.dumps(pod("speech", robot.namespace, IDLE, None)))
    try:
        robot.expect(slam=1000)
        until("the status shows it", lambda: f"{name} is a static pod" in robot.condition("Applied")[1])
        assert robot.api_limit(name) == "500m"
    finally:
        manifest.unlink()
        until("it is gone", lambda: run("kubectl", "get", "pods", "-n", robot.namespace, "-o", "name").count(name) == 0)
