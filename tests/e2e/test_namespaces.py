"""A namespace that is deleted while no operator runs: its policies hold it, and somebody says how to let them go."""

from contextlib import contextmanager

import pytest

from contextpolicy.cli import main
from tests.e2e.cluster import apply_definition, run, until
from tests.e2e.releases import Release


@contextmanager
def governed(release, **values):
    """A robot whose limits a policy has moved, under an operator of its own."""
    apply_definition()
    release.install(**values)
    try:
        with release.robot():
            yield release
    finally:
        release.remove()


@pytest.fixture(scope="module")
def narrow():
    """An operator with rights in this namespace only: they are deleted along with it."""
    with governed(Release("narrow", 56)) as release:
        yield release


@pytest.fixture(scope="module")
def wide():
    """An operator of all namespaces; those that another serves it leaves alone."""
    with governed(Release("wide", 57), watchNamespaces="null") as release:
        yield release


def delete_while_away(release):
    """The operator ends, the namespace is deleted, the operator is back."""
    deployment = ("kubectl", "scale", f"deployment/{release.name}", "-n", release.system)
    labels = f"app.kubernetes.io/component=operator,app.kubernetes.io/instance={release.name}"
    run(*deployment, "--replicas=0")
    run("kubectl", "wait", "pod", "-l", labels, "-n", release.system, "--for=delete", "--timeout=60s")
    run("kubectl", "delete", "namespace", release.namespace, "--wait=false")
    until("only policies are left", lambda: "contextpolicy.dev/restore" in (said := conditions(release)) or said)
    run(*deployment, "--replicas=1")
    run("kubectl", "rollout", "status", f"deployment/{release.name}", "-n", release.system, "--timeout=100s")


def conditions(release):
    """What Kubernetes itself says about why the namespace is still there; empty when it is not."""
    query = ("kubectl", "get", "namespace", release.namespace, "--ignore-not-found")
    return run(*query, "-o", "jsonpath={.metadata.name} {.status.conditions[?(@.status=='True')].message}").strip()


def test_operator_without_rights_logs_a_restore_command_that_works(narrow):
    delete_while_away(narrow)
    advice = f"contextpolicy restore --namespace {narrow.namespace} --remove-finalizers"
    log = ("kubectl", "logs", "-n", narrow.system, f"deployment/{narrow.name}")
    until("the log says what to do", lambda: advice in (said := run(*log)) or said)
    assert narrow.namespace in conditions(narrow), "nobody else lets it go"
    assert main(advice.split()[1:]) == 0
    until("the namespace is gone", lambda: conditions(narrow) == "" or conditions(narrow))


def test_cluster_wide_operator_releases_a_deleted_namespace(wide):
    delete_while_away(wide)
    until("the namespace is gone", lambda: conditions(wide) == "" or conditions(wide))
