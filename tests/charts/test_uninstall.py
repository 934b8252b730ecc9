"""What `helm uninstall` does after the operator is gone: put every container back."""

from __future__ import annotations

import pytest

from tests.charts.conftest import CHART, HOOK, hooks, set_all
from tests.charts.objects import EVERYTHING, container

ADVICE = "Before you uninstall, let the operator put every container back"


def notes(helm, *settings):
    done = helm("install", "contextpolicy", str(CHART), "--dry-run=client", *set_all(settings))
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_rights_come_before_the_job_and_go_after_it(render):
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


def test_nothing_that_uninstalling_makes_is_in_a_namespace_that_may_be_gone(render):
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
def test_without_it_the_notes_list_the_manual_steps(helm, render, setting):
    assert hooks(render(setting, *EVERYTHING), "post-delete") == []
    assert ADVICE in notes(helm, setting)


def test_with_it_there_is_nothing_to_do_by_hand(helm):
    assert ADVICE not in notes(helm)
    assert "kubectl delete ctxp" not in notes(helm)
