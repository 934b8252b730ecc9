"""`contextpolicy restore` where originals are signed, forged, emptied or lost."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.cluster.api import Secret
from tests.actuators.resize.test_vetting import OWNER, PATH, an_owner
from tests.commands.restoring import (
    GREEN,
    RELEASE,
    SECRETS,
    Server,
    before,
    by_us,
    moved,
    policy,
    signed,
    with_spec,
)
from tests.policies.builders import a_policy


def test_signed_originals_are_restored_and_the_key_is_deleted(restore: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=signed(500))])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    assert restore(server, "--remove-finalizers", "--dry-run", RELEASE)[0] == 0
    assert (server.secrets, server.renewals) == (SECRETS, [])
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert (server.cluster.limit("slam"), server.secrets) == (500, {})
    assert (server.leases["lab"].holder, server.leases["lab"].seconds) == ("", 1), "waiting replicas go on at once"


def test_forged_originals_are_replaced_by_the_owners_template(restore: Any) -> None:
    pod = by_us()
    pod["metadata"]["ownerReferences"] = [OWNER]
    server = Server(pod, policies=[policy(originals=before(slam={"request": "100m", "limit": "50m"}))])
    server.secrets, server.cluster.owners = dict(SECRETS), {PATH: an_owner("500m")}
    server.leases = {"lab": GREEN}
    assert restore(server, RELEASE) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert (server.cluster.limit("slam"), server.cluster.policies) == (500, {"lab/robot": {}})


def test_unprovable_originals_keep_the_policy_and_the_key(restore: Any) -> None:
    originals = before(slam={"request": "100m", "limit": "50m"})
    server = Server(by_us(), policies=[policy(originals=originals)])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert code == 1
    assert out.splitlines() == [
        (
            "lab/slam/slam: NOT restored: lab/slam/slam: status.originals has request 100m, limit 50m, not signed by "
            "the operator; no owner of the pod states its original CPU, so it keeps request 100m, limit 990m, "
            "and the entry stays; replace the pod"
        ),
        "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
    ]
    assert (server.cluster.limit("slam"), server.secrets) == (990, SECRETS)
    assert server.cluster.policies == {"lab/robot": originals}


def test_emptied_originals_are_replaced_by_the_owners_template(restore: Any) -> None:
    """Helm deletes what protects a status before it runs the Job."""
    pod = by_us()
    pod["metadata"]["ownerReferences"] = [OWNER]
    server = Server(pod, policies=[with_spec(policy())])
    server.secrets, server.cluster.owners = dict(SECRETS), {PATH: an_owner("500m")}
    server.leases = {"lab": GREEN}
    assert restore(server, "--remove-finalizers", RELEASE)[1].startswith("lab/slam/slam: limit 990m -> 500m\n")
    assert (server.cluster.limit("slam"), server.secrets) == (500, {})
    server.leases = {"lab": GREEN}
    assert restore(server, "--remove-finalizers", RELEASE) == (0, "nothing to restore\n")


def test_unknown_emptied_originals_keep_the_policy_and_the_key(restore: Any) -> None:
    server = Server(by_us(), policies=[with_spec(policy())])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    for _ in range(2):
        code, out = restore(server, "--remove-finalizers", RELEASE)
        assert (code, out.splitlines()) == (
            1,
            [
                (
                    "lab/slam/slam: NOT restored: lab/slam/slam: status.originals no longer has an entry; "
                    "no owner of the pod states its original CPU, so it keeps request 100m, limit 990m"
                ),
                "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
            ],
        )
    assert (server.cluster.limit("slam"), server.secrets) == (990, SECRETS)


def test_conditions_are_not_read(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenant's policy of 1.7 MB took the Job 14 s; it has 240 s to restore what all namespaces had."""
    server = Server(by_us(), policies=[with_spec(policy())])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    read: list[str] = []
    monkeypatch.setattr("contextpolicy.policy.cel_syntax.parse", read.append)
    assert "status.originals no longer has an entry" in restore(server, "--remove-finalizers", RELEASE)[1]
    assert read == []


IDLE: list[dict[str, Any]] = [{}, *(a_policy(mode=mode)["spec"] for mode in ("DryRun", "Paused"))]


@pytest.mark.parametrize("spec", IDLE, ids=["invalid", "dry run", "paused"])
def test_emptied_originals_are_missed_whatever_the_policy_has_become(restore: Any, spec: dict[str, Any]) -> None:
    pod = by_us()
    pod["metadata"]["ownerReferences"] = [OWNER]
    server = Server(pod, policies=[{**policy(), "spec": spec}])
    server.secrets, server.cluster.owners, server.leases = dict(SECRETS), {PATH: an_owner("500m")}, {"lab": GREEN}
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()[0]) == (0, "lab/slam/slam: limit 990m -> 500m")
    assert server.cluster.limit("slam") == 500


@pytest.mark.parametrize("spec", IDLE, ids=["invalid", "dry run", "paused"])
def test_bare_pod_without_an_original_is_named_but_keeps_no_policy(restore: Any, spec: dict[str, Any]) -> None:
    """The last plan of another policy, long deleted, may have given it just what it had."""
    server = Server(by_us(), policies=[{**policy(), "spec": spec}])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()) == (
        0,
        [
            (
                "lab/slam/slam: left as it is: an operator resized it, and no status.originals has an entry for it; "
                "no owner of the pod states its original, so it keeps request 100m, limit 990m"
            ),
            "ContextPolicy lab/robot: finalizer removed",
        ],
    )


def test_original_in_another_policy_is_not_lost(restore: Any) -> None:
    """Both select the container; one of them resized it."""
    policies = [with_spec(policy()), with_spec(policy("other", originals=signed(500, "lab/other")))]
    server = Server(by_us(), policies=policies)
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()[0]) == (0, "lab/slam/slam: limit 990m -> 500m")


@pytest.mark.parametrize("dies", [False, True])
def test_what_a_plan_left_as_it_was_is_known_until_the_finalizer_is_gone(restore: Any, *, dies: bool) -> None:
    """The API server records our last change for ever; without the entry a repeated Job would find an original lost."""
    server = Server(by_us(), moved("speech"), policies=[with_spec(policy(originals=signed(990) | before("gone")))])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    if dies:
        server.conflicts = 1
        assert restore(server, "--remove-finalizers", RELEASE)[0] == 1
        assert server.cluster.originals("uid-slam")
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert (server.cluster.originals("uid-slam"), server.secrets) == ({}, {})
    server.leases = {"lab": GREEN}
    assert restore(server, "--remove-finalizers", RELEASE) == (0, "nothing to restore\n")


def test_entries_of_a_policy_without_finalizer_are_removed(restore: Any) -> None:
    """An attempt ended just after it had removed the finalizer."""
    released = with_spec(policy(originals=signed(990)))
    released["metadata"]["finalizers"] = []
    server = Server(by_us(), policies=[released])
    server.secrets, server.leases = dict(SECRETS), {"lab": GREEN}
    assert restore(server, "--remove-finalizers", RELEASE) == (0, "lab/slam/slam: already restored\n")
    assert (server.cluster.policies, server.secrets) == ({"lab/robot": {}}, {})


@pytest.mark.parametrize("secrets", [{}, {"green/contextpolicy-originals": Secret({}, "1")}])
def test_statuses_are_trusted_without_the_key(restore: Any, secrets: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=before("slam"))])
    server.secrets, server.leases = dict(secrets), {"lab": GREEN}
    assert restore(server, RELEASE) == (0, "lab/slam/slam: limit 990m -> 500m\n")
