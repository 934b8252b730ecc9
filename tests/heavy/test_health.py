"""What GitOps tools make of a policy, by their own libraries: kstatus, Flux' expressions, Argo CD's Lua."""

from __future__ import annotations

import json
import subprocess

import pytest
import yaml

from tests.config.test_gitops import GITOPS, WELL, flux_kustomization, policy
from tests.node import build

CASES = [
    # What is not read yet has no status at all: kstatus alone would take it for done.
    pytest.param({"metadata": {"generation": 1}, "spec": {}}, "Current", "error", "Progressing", id="not read yet"),
    pytest.param(policy(**WELL, observed=1), "InProgress", "InProgress", "Progressing", id="edited"),
    pytest.param(policy(**WELL), "Current", "Current", "Healthy", id="in force"),
    pytest.param(policy(**WELL, StreamsHealthy="False"), "Current", "Current", "Healthy", id="a microphone sleeps"),
    pytest.param(policy(**WELL, Feasible="False"), "Current", "Current", "Healthy", id="more is wanted than there is"),
    # kstatus alone would wait for a refused policy until it times out.
    pytest.param(policy(Accepted="False", Ready="False"), "InProgress", "Failed", "Degraded", id="refused"),
    pytest.param(
        policy(Accepted="True", Connected="False", Ready="False"), "InProgress", "InProgress", "Degraded", id="cut off"
    ),
    pytest.param(policy(mode="Paused", **WELL), "Current", "Current", "Suspended", id="paused"),
]


@pytest.fixture(scope="session")
def judged():
    """Ask for an object's health."""
    program = build.build(build.FLUX) / "health"
    (check,) = flux_kustomization()["spec"]["healthCheckExprs"]
    config = yaml.safe_load((GITOPS / "argocd" / "argocd-cm.yaml").read_text())["data"]
    asked = {
        "expressions": {name: check[name] for name in ("inProgress", "current", "failed")},
        "script": config["resource.customizations.health.contextpolicy.dev_ContextPolicy"],
    }

    def ask(body):
        whole = {"apiVersion": "contextpolicy.dev/v1alpha1", "kind": "ContextPolicy", **body}
        line = json.dumps({"object": whole, **asked})
        done = subprocess.run([program], input=line, capture_output=True, text=True, timeout=60, check=True)
        return json.loads(done.stdout)

    return ask


@pytest.mark.parametrize(("body", "kstatus", "flux", "argo"), CASES)
def test_health(judged, body, kstatus, flux, argo):
    said = judged({**body, "metadata": {"name": "robot", "namespace": "lab", **body["metadata"]}})
    assert (said["kstatus"], said["flux"].partition(":")[0], said["argo"]) == (kstatus, flux, argo)
