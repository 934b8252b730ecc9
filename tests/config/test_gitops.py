"""GitOps: the overlays build, and Argo CD and Flux judge a policy's health as people mean it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import cel
import lupa
import pytest
import yaml

from contextpolicy.cli import main

ROOT = Path(__file__).parents[2]
GITOPS = ROOT / "config" / "gitops"
ROBOTS = sorted((GITOPS / "fleet" / "robots").iterdir())


def built(folder):
    done = subprocess.run(["kubectl", "kustomize", folder], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_base_is_the_sample():
    assert (GITOPS / "fleet/base/delivery-robot.yaml").read_text() == (
        ROOT / "config/policies/delivery-robot.yaml"
    ).read_text()


@pytest.mark.parametrize("folder", ROBOTS, ids=lambda folder: folder.name)
def test_a_robots_overlay_builds_a_valid_policy_of_its_own(folder, tmp_path, capsys):
    text = built(folder)
    policy = yaml.safe_load(text)
    assert policy["metadata"]["namespace"] == folder.name
    assert policy["spec"] != yaml.safe_load(built(GITOPS / "fleet/base"))["spec"]
    (tmp_path / "policy.yaml").write_text(text)
    assert main(["validate", str(tmp_path / "policy.yaml")]) == 0, capsys.readouterr().out


def test_an_overlay_does_not_change_another_stream_when_the_base_is_reordered(tmp_path):
    fleet = tmp_path / "fleet"
    subprocess.run(["cp", "-r", GITOPS / "fleet", fleet], check=True, timeout=10)
    base = fleet / "base" / "delivery-robot.yaml"
    policy = yaml.safe_load(base.read_text())
    policy["spec"]["streams"].reverse()
    base.write_text(yaml.safe_dump(policy))
    with pytest.raises(AssertionError, match="test"):
        built(fleet / "robots" / "hall-2")


def flux_kustomization():
    """The example of a Kustomization with policies."""
    documents = yaml.safe_load_all((GITOPS / "flux" / "policies.yaml").read_text(encoding="utf-8"))
    return next(one for one in documents if one["kind"] == "Kustomization")


def policy(mode="Enforce", generation=2, observed=2, **conditions):
    reported = [{"type": kind, "status": status, "message": f"{kind} {status}"} for kind, status in conditions.items()]
    status = {"observedGeneration": observed, "conditions": reported} if conditions else {}
    return {"metadata": {"generation": generation}, "spec": {"mode": mode}, "status": status}


WELL = {"Accepted": "True", "Connected": "True", "Applied": "True", "Ready": "True"}
CASES = [
    pytest.param(policy(), "Progressing", "inProgress", id="not read yet"),
    pytest.param(policy(**WELL, observed=1), "Progressing", "inProgress", id="edited"),
    pytest.param(policy(**WELL), "Healthy", "current", id="in force"),
    pytest.param(policy(**WELL, StreamsHealthy="False"), "Healthy", "current", id="a microphone sleeps"),
    pytest.param(policy(**WELL, Feasible="False"), "Healthy", "current", id="a task wants more than there is"),
    pytest.param(policy(Accepted="False", Ready="False"), "Degraded", "failed", id="refused"),
]


@pytest.mark.parametrize(("policy", "argo", "flux"), CASES)
def test_argo_cd_health(policy, argo, flux):  # noqa: ARG001 - the cases are Flux' too
    config = yaml.safe_load((GITOPS / "argocd" / "argocd-cm.yaml").read_text(encoding="utf-8"))["data"]
    script = config["resource.customizations.health.contextpolicy.dev_ContextPolicy"]
    lua = lupa.LuaRuntime()
    health = lua.execute(f"return function(obj) {script} end")(lua.table_from(policy, recursive=True))
    assert health["status"] == argo


def test_a_paused_policy_is_suspended_for_argo_cd():
    test_argo_cd_health(policy(mode="Paused", **WELL), "Suspended", "current")


@pytest.mark.parametrize(("policy", "argo", "flux"), CASES)
def test_flux_health(policy, argo, flux):  # noqa: ARG001 - the cases are Argo CD's too
    """Flux asks in this order, and takes the first that holds."""
    (check,) = flux_kustomization()["spec"]["healthCheckExprs"]
    verdicts = (kind for kind in ("inProgress", "failed", "current") if cel.evaluate(check[kind], policy))
    assert next(verdicts, None) == flux
