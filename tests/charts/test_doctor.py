"""`helm test`: the doctor looks at the release, with rights that last as long as the test."""

from __future__ import annotations

import pytest

from tests.charts.conftest import HOOK, hooks
from tests.charts.objects import EVERYTHING


def test_hooks_create_rights_first_and_are_deleted_afterwards(render):
    kinds = [item["kind"] for item in hooks(render(), "test")]
    assert kinds == ["ServiceAccount", "ClusterRole", "ClusterRoleBinding", "Pod"]
    for item in hooks(render(*EVERYTHING), "test"):
        kept = item["metadata"]["annotations"][f"{HOOK}-delete-policy"]
        assert kept == "hook-succeeded,hook-failed,before-hook-creation"


def test_doctor_has_read_only_rights(render):
    role = render(*EVERYTHING)["ClusterRole", "contextpolicy-doctor"]
    verbs = {(resource, verb) for rule in role["rules"] for resource in rule["resources"] for verb in rule["verbs"]}
    assert {verb for resource, verb in verbs if resource != "subjectaccessreviews"} == {"list", "get"}


@pytest.mark.parametrize(
    ("settings", "namespaces"),
    [((), []), (("watchNamespaces={robot,lab}",), ["--namespace=robot", "--namespace=lab"])],
)
def test_it_judges_the_policies_that_the_operator_serves(render, settings, namespaces):
    pod = render(*settings)["Pod", "contextpolicy-doctor"]
    assert pod["spec"]["containers"][0]["args"] == ["doctor", *namespaces]
    assert pod["spec"]["serviceAccountName"] == "contextpolicy-doctor"


def test_findings_are_printed_by_default(render):
    pod = render()["Pod", "contextpolicy-doctor"]
    assert pod["metadata"]["annotations"][f"{HOOK}-output-log-policy"] == "hook-succeeded,hook-failed"


def test_no_helm_test_without_rbac(render):
    assert hooks(render("rbac.create=false"), "test") == []
