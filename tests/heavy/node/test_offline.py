"""The archive of a release on the node, which no network reaches: one command, and nothing is pulled."""

from __future__ import annotations

import json
import os
import subprocess
from itertools import chain

import pytest

from charts.release.version import versions
from tests.e2e.cluster import REPOSITORY, apply_definition, run, until
from tests.node.layout import BIN, CONTAINERD_SOCKET
from timelines.demo.deploy import free_address

SYSTEM = "e2e-offline"
CTR = f"{BIN}/ctr --address {CONTAINERD_SOCKET}"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """What the archive's own command installed."""
    archives = list((REPOSITORY / "build" / "release").glob("contextpolicy-*-airgap.tar"))
    assert len(archives) == 1, "run `make heavy`"
    folder = tmp_path_factory.mktemp("robot")
    run("tar", "xf", str(archives[0]), "-C", str(folder))
    settings = {
        "fullnameOverride": "offline",
        "crds.enabled": "false",
        "watchNamespaces": "{nowhere-yet}",
        "router.service.clusterIP": free_address(54),
        "networkPolicy.enabled": "true",
    }
    options = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    command = [*folder.glob("*/install.sh"), "--namespace", SYSTEM, "--timeout", "120s", *options]
    apply_definition()
    run("kubectl", "create", "namespace", "nowhere-yet")
    try:
        done = subprocess.run(
            command, env={**os.environ, "CTR": CTR}, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        yield SYSTEM
    finally:
        run("helm", "uninstall", "contextpolicy", "--namespace", SYSTEM, "--ignore-not-found", "--timeout", "60s")
        run("kubectl", "delete", "namespace", SYSTEM, "nowhere-yet", "--ignore-not-found", "--timeout=90s")


def test_operator_and_router_run_the_releases_image(installed):
    (version,) = set(chain(*versions(REPOSITORY).values()))
    pods = json.loads(run("kubectl", "get", "pods", "-n", installed, "-o", "json"))["items"]
    assert len(pods) == 3, "operator, router, and what made their certificates"
    for pod in pods:
        (container,) = pod["spec"]["containers"]
        assert container["imagePullPolicy"] == "Never"
        assert container["image"] == f"contextpolicy:{version}"
        assert pod["status"]["phase"] == "Succeeded" or pod["status"]["containerStatuses"][0]["ready"]


def test_nothing_was_pulled(installed):
    events = json.loads(run("kubectl", "get", "events", "-n", installed, "-o", "json"))["items"]
    assert events
    assert [one["message"] for one in events if one["reason"] == "Pulling"] == []


def test_helm_test_finds_nothing_wrong_and_leaves_nothing(installed):
    command = ["helm", "test", "contextpolicy", "--namespace", installed, "--timeout", "120s"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    said = done.stdout + done.stderr  # helm logs what the pod said
    assert done.returncode == 0, said
    assert "operator's rights: complete" in said
    assert "BAD" not in said
    kinds = "pods,serviceaccounts,clusterroles,clusterrolebindings,networkpolicies"
    left = ("kubectl", "get", kinds, "-A", "-l", "app.kubernetes.io/component=doctor", "-o", "name")
    until("nothing of the test is there", lambda: run(*left) == "" or run(*left))
