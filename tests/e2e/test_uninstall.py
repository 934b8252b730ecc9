"""`helm uninstall` leaves the robot as it was: a release of its own, whose operator moves limits and then goes."""

import json

import pytest

from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import REPOSITORY, apply, delete, get, run, until
from tests.e2e.robot import Robot, Sensors
from timelines.demo.deploy import free_address

RELEASE, SYSTEM, NAMESPACE = "leave", "e2e-leave-system", "e2e-leave"
KINDS = "jobs,pods,serviceaccounts,roles,rolebindings,clusterroles,clusterrolebindings,deployments,services"


def install():
    """The definition comes from elsewhere, so that no other release loses it."""
    definition = REPOSITORY / "crds" / "contextpolicies.contextpolicy.dev.yaml"
    run("kubectl", "apply", "--server-side", "--force-conflicts", "-f", str(definition))
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAMESPACE}})
    values = {
        "fullnameOverride": RELEASE,
        "image.tag": "dev",
        "crds.enabled": "false",
        "router.service.clusterIP": free_address(50),
        "watchNamespaces": "{" + NAMESPACE + "}",
    }
    settings = [part for name, value in values.items() for part in ("--set", f"{name}={value}")]
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    run(
        *("helm", "upgrade", "--install", RELEASE, chart, "--namespace", SYSTEM, "--create-namespace", *settings),
        *("--wait", "--timeout", "120s"),
        timeout=150,
    )


def remove_namespaces():
    """Policies first: one that a failed test left behind may be held, with nobody to let it go."""
    run("kubectl", "delete", "ctxp", "--all", "-n", NAMESPACE, "--wait=false")
    for name in run("kubectl", "get", "ctxp", "-n", NAMESPACE, "-o", "name").split():
        run("kubectl", "patch", name, "-n", NAMESPACE, "--type=merge", "-p", '{"metadata":{"finalizers":null}}')
    run("kubectl", "delete", "namespace", SYSTEM, NAMESPACE, "--ignore-not-found", "--timeout=90s")


@pytest.fixture(scope="module")
def left():
    """A robot whose limits a policy had moved when its operator was uninstalled.

    Helm does not wait for the operator's end: the harder case.
    """
    install()
    try:
        with open_visitor([f"tcp/{free_address(50)}:7447"], patience=20) as session, Sensors(session) as sensors:
            robot = Robot(NAMESPACE, sensors)
            robot.drive(0.3)
            robot.start("slam", "speech")
            robot.policy()
            robot.expect(slam=990, speech=10)
        run("helm", "uninstall", RELEASE, "--namespace", SYSTEM, "--timeout", "60s")
        yield robot
    finally:
        remove_namespaces()


def test_containers_are_as_they_were(left):
    left.expect(slam=500, speech=500)
    for name in ("slam", "speech"):
        pod = get("pod", name, NAMESPACE)
        assert pod["spec"]["containers"][0]["resources"] == {
            "requests": {"cpu": "10m", "memory": "32Mi"},
            "limits": {"cpu": "500m", "memory": "64Mi"},
        }
        assert pod["status"]["containerStatuses"][0]["restartCount"] == 0


def test_nothing_of_the_release_stays(left):
    def remaining():
        found = run("kubectl", "get", KINDS, "-A", "-o", "json", "-l", f"app.kubernetes.io/instance={RELEASE}")
        names = [f"{item['kind']} {item['metadata']['name']}" for item in json.loads(found)["items"]]
        return names or True

    until("nothing of the release is there", remaining)
    assert left.limits("slam", "speech") == {"slam": 500, "speech": 500}


def test_the_policy_stays_and_can_be_deleted_at_once(left):
    policy = get("ctxp", "robot", left.namespace)
    assert "deletionTimestamp" not in policy["metadata"]
    assert not policy["status"].get("originals")
    delete("ctxp", "robot", left.namespace)
    assert run("kubectl", "get", "ctxp", "-n", left.namespace, "-o", "name") == ""
