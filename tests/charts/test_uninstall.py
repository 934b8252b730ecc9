"""What `helm uninstall` does after the operator is gone: put every container back."""

from __future__ import annotations

import pytest

from tests.charts.conftest import CHART, HOOK, hooks, set_all
from tests.charts.objects import EVERYTHING, container

ADVICE = "Before you uninstall, let the operator restore every container"


def notes(helm, *settings):
    done = helm("install", "contextpolicy", str(CHART), "--dry-run=client", *set_all(settings))
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_hooks_create_rights_before_the_job(render):
    kinds = [item["kind"] for item in hooks(render(), "post-delete")]
    assert kinds[0] == "ServiceAccount"
    assert sorted(kinds[1:3]) == ["ClusterRole", "Role"]
    assert sorted(kinds[3:-1]) == ["ClusterRoleBinding", "RoleBinding"]
    assert kinds[-1] == "Job"
    for item in hooks(render(*EVERYTHING), "post-delete"):
        assert item["metadata"]["annotations"][f"{HOOK}-delete-policy"] == "hook-succeeded,before-hook-creation"


@pytest.mark.parametrize(
    ("settings", "namespaces"),
    [((), []), (("watchNamespaces={robot,lab}",), ["--namespace=robot", "--namespace=lab"])],
)
def test_the_job_restores_what_the_operator_served(render, settings, namespaces):
    job = render(*settings)["Job", "contextpolicy-restore"]
    assert container(job)["args"] == [
        "restore",
        "--remove-finalizers",
        "--release=contextpolicy-system/contextpolicy",
        *namespaces,
    ]
    assert job["spec"]["template"]["spec"]["serviceAccountName"] == "contextpolicy-restore"


def test_uninstall_hooks_live_in_the_releases_namespace(render):
    """Somebody deleted one of those that were watched: `helm uninstall` would stop there, and restore nothing."""
    made = hooks(render("watchNamespaces={robot,gone}"), "post-delete")
    assert made
    assert {item["metadata"].get("namespace", "contextpolicy-system") for item in made} == {"contextpolicy-system"}


def test_the_job_reaches_the_api_and_nothing_else(render):
    spec = render(*EVERYTHING)["NetworkPolicy", "contextpolicy-restore"]["spec"]
    assert spec["egress"] == [{"ports": [{"port": 443}, {"port": 6443}]}]
    assert spec["ingress"] == []
    labels = render(*EVERYTHING)["Job", "contextpolicy-restore"]["spec"]["template"]["metadata"]["labels"]
    assert spec["podSelector"]["matchLabels"].items() <= labels.items()


@pytest.mark.parametrize("setting", ["restoreOnUninstall=false", "rbac.create=false"])
def test_notes_list_the_manual_steps_without_the_job(helm, render, setting):
    assert hooks(render(setting, *EVERYTHING), "post-delete") == []
    assert ADVICE in notes(helm, setting)


def test_notes_list_no_manual_steps_with_the_job(helm):
    assert ADVICE not in notes(helm)
    assert "kubectl delete ctxp" not in notes(helm)
