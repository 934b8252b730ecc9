"""Policies in Git: Flux' own kustomize-controller brings them to the node, and judges them as the example says."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess

import pytest

from tests.config.test_gitops import flux_kustomization
from tests.e2e.cluster import apply, apply_definition, get, run, until
from tests.e2e.releases import Release
from tests.e2e.robot import IDLE, pod, policy
from tests.heavy.node.source_stand_in import GROUP, KINDS, Repository, definitions
from tests.node import build
from tests.node.layout import SOURCES

SYSTEM = "e2e-flux"
KIND = "kustomization.kustomize.toolkit.fluxcd.io"
NAME = "robot-policies"
DEFINITIONS = [f"{plural}.{GROUP}" for plural in KINDS.values()] + ["kustomizations.kustomize.toolkit.fluxcd.io"]
MODULE = "github.com/fluxcd/kustomize-controller"


@pytest.fixture(scope="module")
def release():
    """A robot of its own operator; its policies are not there yet."""
    release = Release("fluxed", 53)
    apply_definition()
    release.install()
    try:
        yield release
    finally:
        release.remove()


@pytest.fixture(scope="module")
def controller(tmp_path_factory):
    """The controller, from outside of the cluster."""
    where = ["go", "-C", SOURCES / "flux", "list", "-m", "-f", "{{.Dir}}", MODULE]
    folder = run(*map(str, where)).strip()
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": SYSTEM}}, *definitions())
    run("kubectl", "apply", "--server-side", "-f", f"{folder}/config/crd/bases")
    run("kubectl", "wait", "crd", *DEFINITIONS, "--for=condition=Established", "--timeout=60s")
    flags = ["--enable-leader-election=false", "--metrics-addr=127.0.0.1:0", "--health-addr=127.0.0.1:0"]
    argv = [str(build.build(build.FLUX) / "kustomize-controller"), *flags, "--events-addr="]
    log = tmp_path_factory.mktemp("flux") / "kustomize-controller.log"
    with log.open("w") as file:
        process = subprocess.Popen(
            argv, stdout=file, stderr=file, env={**os.environ, "RUNTIME_NAMESPACE": SYSTEM, "HOME": str(log.parent)}
        )
    yield log
    with contextlib.suppress(AssertionError):
        run("kubectl", "delete", KIND, "--all", "-n", SYSTEM, "--timeout=60s")
    process.terminate()
    process.wait(30)
    run("kubectl", "delete", "namespace", SYSTEM, "--ignore-not-found", "--timeout=90s")
    run("kubectl", "delete", "crd", *DEFINITIONS, "--ignore-not-found", "--timeout=60s")


@pytest.fixture(scope="module")
def repository(controller, tmp_path_factory):  # noqa: ARG001 - announces to the controller, once it is there
    repository = Repository(tmp_path_factory.mktemp("git"), NAME, SYSTEM)
    yield repository
    repository.close()


@pytest.fixture(scope="module")
def robot(release):
    with release.robot() as robot:
        run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")
        robot.expect(slam=500, speech=500)
        yield robot


@pytest.fixture
def synced(robot, repository):
    """The example's Kustomization of a repository with the robot's policy, in force; the robot moves."""
    robot.drive(0.3)
    spec = {**flux_kustomization()["spec"], "targetNamespace": robot.namespace, "interval": "1h", "retryInterval": "5s"}
    revision = repository.commit("Begin", policy=policy(robot.namespace), arm=deployment(robot.namespace))
    metadata = {"name": NAME, "namespace": SYSTEM}
    apply({"apiVersion": "kustomize.toolkit.fluxcd.io/v1", "kind": "Kustomization", "metadata": metadata, "spec": spec})
    reconciled(revision)
    robot.expect(slam=990, speech=10)
    yield repository
    run("kubectl", "delete", KIND, NAME, "-n", SYSTEM, "--ignore-not-found", "--timeout=60s")


def deployment(namespace):
    """A task that stands in Git itself."""
    template = pod("arm", namespace, IDLE, None)
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": "arm", "namespace": namespace},
        "spec": {
            "selector": {"matchLabels": {"app": "arm"}},
            "template": {
                "metadata": {"labels": {"app": "arm"}},
                "spec": {"terminationGracePeriodSeconds": 0, "containers": template["spec"]["containers"]},
            },
        },
    }


def ready():
    """Which revision Flux has tried, whether it calls it ready, and its reason."""
    status = get(KIND, NAME, SYSTEM).get("status", {})
    reported: dict[str, str] = next((one for one in status.get("conditions", []) if one["type"] == "Ready"), {})
    return status.get("lastAttemptedRevision"), reported.get("status"), reported.get("reason")


def reconciled(revision, verdict="True", reason="ReconciliationSucceeded"):
    until(f"Flux says {verdict} to {revision}", lambda: ready() == (revision, verdict, reason) or ready())


def reconcile():
    """Ask Flux to look again, and wait until it did."""
    asked = os.urandom(4).hex()
    run("kubectl", "annotate", KIND, NAME, "-n", SYSTEM, "--overwrite", f"reconcile.fluxcd.io/requestedAt={asked}")
    until("Flux looked", lambda: get(KIND, NAME, SYSTEM)["status"].get("lastHandledReconcileAt") == asked)
    until("Flux is done", lambda: ready()[1] != "Unknown" or ready())


def test_a_commit_changes_the_cgroup(synced, robot):
    reconciled(synced.commit("Keep more for others", policy=policy(robot.namespace, reserve="1500m")))
    robot.expect(slam=490, speech=10)


def test_resizes_are_not_drift(synced, robot):
    with_arm = policy(robot.namespace, tasks=[*policy(robot.namespace)["spec"]["tasks"], arm_task()])
    reconciled(synced.commit("Govern the arm", policy=with_arm))
    until("the arm's limit has moved", lambda: limit("arm", robot.namespace) not in ("", "500m"))
    until("the plan is in force", lambda: robot.condition("Applied")[0] == "True")
    before = get("deployment", "arm", robot.namespace)["metadata"]["generation"], pods("arm", robot.namespace)
    limits = limit("arm", robot.namespace), robot.limits("slam", "speech")
    reconcile()
    assert (get("deployment", "arm", robot.namespace)["metadata"]["generation"], pods("arm", robot.namespace)) == before
    assert (limit("arm", robot.namespace), robot.limits("slam", "speech")) == limits
    assert ready()[1] == "True"


def test_a_silent_sensor_is_not_a_failure_of_the_policy(synced, robot):
    robot.sensors.read(f"{robot.namespace}/imu", None)
    until("the stream is silent", lambda: robot.condition("StreamsHealthy")[0] == "False")
    reconciled(synced.commit("Say more", policy=policy(robot.namespace), notes=notes(robot.namespace)))
    assert robot.condition("StreamsHealthy")[0] == "False"
    robot.drive(0.3)


def test_a_policy_that_is_refused_fails_at_once_and_the_last_one_stays_in_force(synced, robot):
    broken = [{"name": "moving", "when": "imu.speed >", "tasks": {"speech": {"suspend": True}}}]
    revision = synced.commit("Forget a number", policy=policy(robot.namespace, contexts=broken))
    reconciled(revision, "False", "HealthCheckFailed")
    message = next(one for one in get(KIND, NAME, SYSTEM)["status"]["conditions"] if one["type"] == "Ready")["message"]
    assert "failed" in message.lower()
    assert "timeout" not in message.lower()
    assert robot.limits("slam", "speech") == {"slam": 990, "speech": 10}
    reconciled(synced.commit("Remember it", policy=policy(robot.namespace)))


def test_pruning_restores_containers_and_completes(synced, robot):
    assert synced
    run("kubectl", "delete", KIND, NAME, "-n", SYSTEM, "--timeout=60s")
    until("the policy is gone", lambda: run("kubectl", "get", "ctxp", "-n", robot.namespace, "-o", "name") == "")
    robot.expect(slam=500, speech=500)


def test_pruning_ends_also_when_the_operator_goes_first(synced, robot, release):
    assert synced
    release.uninstall()
    run("kubectl", "delete", KIND, NAME, "-n", SYSTEM, "--timeout=60s")
    until("the policy is gone", lambda: run("kubectl", "get", "ctxp", "-n", robot.namespace, "-o", "name") == "")
    robot.expect(slam=500, speech=500)


def arm_task():
    return {"name": "arm", "selector": {"matchLabels": {"app": "arm"}}, "priority": 3}


def notes(namespace):
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "notes", "namespace": namespace}, "data": {}}


def pods(task, namespace):
    found = json.loads(run("kubectl", "get", "pods", "-n", namespace, "-l", f"app={task}", "-o", "json"))["items"]
    return [one["metadata"]["uid"] for one in found]


def limit(task, namespace):
    """The CPU limit that the API has for the task's only pod."""
    template = "{.items[*].spec.containers[0].resources.limits.cpu}"
    return run("kubectl", "get", "pods", "-n", namespace, "-l", f"app={task}", "-o", f"jsonpath={template}")
