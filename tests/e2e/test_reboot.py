"""The node stops and starts, as a robot that is switched off and on. Runs outside of the node's network."""

import json

import pytest

from tests.e2e.cluster import REPOSITORY, until
from tests.e2e.robot import IDLE, pod, policy, task
from tests.node import access, lifecycle

ROBOT, SYSTEM = "e2e-reboot", "e2e-reboot-system"

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="stops the node: not on yours")


def kubectl(*argv):
    return access.run(["kubectl", *argv], timeout=120)


@pytest.fixture(scope="module")
def apply(tmp_path_factory):
    """kubectl apply of objects."""
    manifest = tmp_path_factory.mktemp("reboot") / "objects.json"

    def apply_objects(*objects):
        manifest.write_text(json.dumps({"apiVersion": "v1", "kind": "List", "items": list(objects)}))
        kubectl("apply", "-f", str(manifest))

    return apply_objects


def limits():
    """What the API has and what the kubelet reports as in force, by pod."""
    items = json.loads(kubectl("get", "pods", "-n", ROBOT, "-o", "json"))["items"]
    return {
        item["metadata"]["name"]: (
            item["spec"]["containers"][0]["resources"]["limits"]["cpu"],
            status.get("resources", {}).get("limits", {}).get("cpu") if "running" in status["state"] else None,
        )
        for item in items
        for status in item["status"].get("containerStatuses", [])
    }


@pytest.fixture
def installed(apply):
    """The operator, installed for this test alone."""
    lifecycle.up()
    for name in (ROBOT, SYSTEM):
        apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name}})
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    values = [
        "image.repository=contextpolicy",
        "image.tag=dev",
        "fullnameOverride=reboot",
        f"watchNamespaces={{{ROBOT}}}",
    ]
    values += ["router.service.clusterIP=10.96.7.51"]
    settings = [part for value in values for part in ("--set", value)]
    install = ["helm", "upgrade", "--install", "reboot", chart, "--namespace", SYSTEM, *settings]
    access.run([*install, "--take-ownership", "--force-conflicts", "--wait", "--timeout", "120s"], timeout=150)
    yield
    kubectl("delete", "ctxp", "--all", "-n", ROBOT, "--timeout=60s")
    access.run(["helm", "uninstall", "reboot", "--namespace", SYSTEM, "--wait", "--timeout", "60s"], timeout=90)
    kubectl("delete", "namespace", ROBOT, SYSTEM, "--timeout=90s")


@pytest.mark.usefixtures("installed")
def test_after_a_reboot_the_policy_holds_and_can_still_be_undone(apply):
    apply(*(pod(name, ROBOT, IDLE, None) for name in ("slam", "speech")))
    apply(policy(ROBOT, tasks=[task("slam", priority=3), task("speech")]))
    planned = {"slam": ("750m", "750m"), "speech": ("250m", "250m")}
    until("the policy holds", lambda: limits() == planned or limits(), patience=120)
    lifecycle.down(keep_state=True)
    lifecycle.up()
    until("the policy holds after the reboot", lambda: limits() == planned or limits(), patience=120)
    kubectl("delete", "ctxp", "robot", "-n", ROBOT, "--timeout=90s")
    original = {"slam": ("500m", "500m"), "speech": ("500m", "500m")}
    until("every container is as it was", lambda: limits() == original or limits(), patience=60)
