"""The k3s way to install: a HelmChart manifest, carried out by k3s's own helm-controller on the node."""

from __future__ import annotations

import base64
import contextlib
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.e2e.cluster import REPOSITORY, CommandError, apply, apply_definition, get, run, until
from tests.e2e.robot import IDLE, pod, policy, task
from tests.node import access, build, images
from tests.node.layout import K3S, KUBECONFIG
from timelines.demo.deploy import free_address

NAME, SYSTEM, ROBOT = "e2e-helmchart", "e2e-helmchart-system", "e2e-helmchart"
JOB = "contextpolicy-helm-job"
DEFINITIONS = ("helmcharts.helm.cattle.io", "helmchartconfigs.helm.cattle.io")
VALUES = {
    "fullnameOverride": NAME,
    "image": {"repository": "contextpolicy", "tag": "dev"},
    "watchNamespaces": [ROBOT],
    "crds": {"enabled": False},  # other tests share the definition
}

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="k3s has its own helm-controller")


@pytest.fixture
def job_image(tmp_path):
    """What the jobs run: helm, with the node's own."""
    source = Path(__file__).with_name("helm_job")
    context = tmp_path / "context"
    context.mkdir()
    for file in (build.build(build.HELM) / "helm", source / "entry.sh"):
        shutil.copy(file, context)
    return images.image(JOB, source / "Dockerfile", context)


@pytest.fixture
def controller(tmp_path):
    """helm-controller, which k3s runs inside of itself; it brings the definition of HelmChart."""
    program = build.build(build.HELM_CONTROLLER) / "helm-controller"
    log = tmp_path / "helm-controller.log"
    argv = [str(program), "--kubeconfig", str(KUBECONFIG), "--node-name", "contextpolicy-node"]
    with log.open("w") as said, subprocess.Popen(argv, stdout=said, stderr=said) as process:
        try:
            until("helm-controller has its definitions", lambda: served() or log.read_text())
            yield process
        finally:
            process.terminate()
            process.wait(20)
    run("kubectl", "delete", "crd", *DEFINITIONS, "--timeout=60s")


def served():
    established = 'jsonpath={.items[*].status.conditions[?(@.type=="Established")].status}'
    found = run("kubectl", "get", "crd", *DEFINITIONS, "--ignore-not-found", "-o", established)
    return found.split() == ["True", "True"]


@pytest.fixture
def chart(tmp_path):
    """The chart as a HelmChart carries it."""
    run("helm", "package", str(REPOSITORY / "charts" / "contextpolicy"), "--destination", str(tmp_path))
    [package] = tmp_path.glob("*.tgz")
    return base64.b64encode(package.read_bytes()).decode()


@pytest.fixture
def robot():
    apply_definition()
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": ROBOT}})
    apply(*(pod(name, ROBOT, IDLE, None) for name in ("slam", "speech")))
    yield
    run("kubectl", "delete", "namespace", ROBOT, SYSTEM, "--ignore-not-found", "--timeout=90s")


def manifest(chart, job_image):
    """The sample for users, but for where the chart and the job's image come from."""
    sample = yaml.safe_load((K3S / "helmchart.yaml").read_text())
    sample["metadata"]["name"] = NAME
    values = VALUES | {"router": {"service": {"clusterIP": free_address(53)}}}
    spec = {"targetNamespace": SYSTEM, "chartContent": chart, "jobImage": job_image}
    sample["spec"] |= spec | {"valuesContent": yaml.safe_dump(values)}
    del sample["spec"]["chart"]
    return sample


def limits():
    """What the kubelet reports as in force."""
    pods = [get("pod", name, ROBOT) for name in ("slam", "speech")]
    statuses = [status for one in pods for status in one["status"].get("containerStatuses", [])]
    return [status.get("resources", {}).get("limits", {}).get("cpu") for status in statuses]


@pytest.mark.usefixtures("controller", "robot")
def test_helmchart_manifest_installs_and_its_deletion_restores(chart, job_image):
    apply(manifest(chart, job_image))
    until("the operator is installed and ready", lambda: ready() or jobs(), patience=180)
    apply(policy(ROBOT, tasks=[task("slam", priority=3), task("speech")]))
    until("the policy's plan is in force", lambda: limits() == ["750m", "250m"] or limits())
    run("kubectl", "delete", "helmchart", NAME, "-n", "kube-system", "--timeout=180s", timeout=200)
    until("every container is as it was", lambda: limits() == ["500m", "500m"] or limits())
    assert run("helm", "list", "--namespace", SYSTEM, "--short") == ""


def ready():
    deployments = run("kubectl", "get", "deployments", "-n", SYSTEM, "-o", "jsonpath={.items[*].status.readyReplicas}")
    return deployments.split() == ["1", "1"]


def jobs():
    """What helm-controller's jobs say."""
    chosen = ("-n", "kube-system", "-l", f"helmcharts.helm.cattle.io/chart={NAME}")
    with contextlib.suppress(CommandError):  # its container is just being made
        return run("kubectl", "logs", *chosen, "--tail=20")
    return run("kubectl", "get", "pods", *chosen)
