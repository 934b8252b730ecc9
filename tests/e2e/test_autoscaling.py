"""A HorizontalPodAutoscaler by CPU utilisation beside a policy: it divides what is used by the CPU request.

The autoscaler is Kubernetes' own; only the readings are made up: each pod uses 30m, whatever its share is.
"""

import pytest

from tests.e2e.cluster import apply, delete, get, run, until
from tests.e2e.readings import Readings, metrics_api
from tests.e2e.robot import IDLE, pod, task
from tests.node import access

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="serves metrics on the node: not on yours")
REQUEST, USED = 100, 30
RESOURCES = {"requests": {"cpu": f"{REQUEST}m", "memory": "16Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}
SYNCS = 2
"""Of the autoscaler, every 5 s on our node: after so many it has seen the newest requests."""


@pytest.fixture
def readings(tmp_path):
    made = Readings(USED)
    with metrics_api(tmp_path, made):
        yield made


@pytest.fixture
def robot(empty, readings):  # noqa: ARG001 - an autoscaler without metrics does nothing
    """speech is scaled by its CPU utilisation: at 30 % of its request, well below the target."""
    empty.start("slam")
    template = pod("speech", empty.namespace, IDLE, RESOURCES)
    labels = {"app": "speech"}
    apply(
        {
            "apiVersion": "apps/v1",
            "kind": "Deployment",
            "metadata": {"name": "speech", "namespace": empty.namespace},
            "spec": {
                "selector": {"matchLabels": labels},
                "template": {"metadata": {"labels": labels}, "spec": template["spec"]},
            },
        },
        {
            "apiVersion": "autoscaling/v2",
            "kind": "HorizontalPodAutoscaler",
            "metadata": {"name": "speech", "namespace": empty.namespace},
            "spec": {
                "scaleTargetRef": {"apiVersion": "apps/v1", "kind": "Deployment", "name": "speech"},
                "minReplicas": 1,
                "maxReplicas": 3,
                "metrics": [
                    {
                        "type": "Resource",
                        "resource": {"name": "cpu", "target": {"type": "Utilization", "averageUtilization": 60}},
                    }
                ],
            },
        },
    )
    run("kubectl", "rollout", "status", "deploy/speech", "-n", empty.namespace, "--timeout=60s")
    yield empty
    delete("hpa", "speech", empty.namespace)
    delete("deploy", "speech", empty.namespace)


def utilisation(robot):
    """What the autoscaler says of speech, in percent of its request; None before it has looked."""
    found = get("hpa", "speech", robot.namespace)["status"].get("currentMetrics") or []
    return found[0].get("resource", {}).get("current", {}).get("averageUtilization") if found else None


def replicas(robot):
    return get("deploy", "speech", robot.namespace)["spec"]["replicas"]


def test_limit_control_does_not_affect_autoscaling(robot, readings):
    robot.policy(enforcement={"control": "Limit"}, tasks=[task("slam"), task("speech")])
    until("the autoscaler has looked", lambda: utilisation(robot) == USED, patience=120)
    robot.drive(0.3)
    robot.expect(slam=900)
    asked = readings.asked
    until("the autoscaler has looked again", lambda: readings.asked >= asked + SYNCS, patience=120)
    assert (utilisation(robot), replicas(robot)) == (USED, 1)


def test_weights_are_requests_and_so_scale(robot):
    """As the operator's README says: a suspended task looks overloaded, because its request is next to nothing."""
    robot.policy(enforcement={"control": "Weight"}, tasks=[task("slam"), task("speech")])
    robot.drive(0.3)
    until("it looks overloaded", lambda: (utilisation(robot) or 0) > 100, patience=120)
    until("it was scaled", lambda: replicas(robot) > 1, patience=120)
