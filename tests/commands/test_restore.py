"""`contextpolicy restore` against an API server in memory."""

from __future__ import annotations

import json
from itertools import chain
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.paging import items
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER
from tests.cluster.builders import a_pod, cpu
from tests.cluster.paged_server import MIB, PagedServer, a_heavy_pod, a_heavy_policy, peak
from tests.commands.restoring import (
    BEFORE,
    REFUSED,
    Server,
    before,
    moved,
    policy,
)

if TYPE_CHECKING:
    import pytest


def test_container_is_restored_before_its_original_is_removed(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    assert restore(server) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert server.cluster.limit("slam") == 500
    assert server.cluster.policies == {"lab/robot": {}}
    assert [call for call, *_ in server.cluster.calls] == ["resize", "store"]


def test_request_and_limit_of_every_container_are_put_back(restore: Any) -> None:
    containers = {"slam": cpu("980m", "990m"), "helper": cpu("10m", "10m")}
    originals = before(slam=BEFORE, helper={"request": "10m", "limit": "1"})
    server = Server(a_pod("slam", containers), policies=[policy(originals=originals)])
    code, out = restore(server)
    assert code == 0
    assert out == "lab/slam/helper: limit 10m -> 1\nlab/slam/slam: limit 990m -> 500m, request 980m -> 100m\n"
    assert server.cluster.limits("uid-slam") == {"slam": 500, "helper": 1000}
    assert len(server.cluster.resizes()) == 1


def test_decreases_are_restored_first(restore: Any) -> None:
    risen = a_pod("speech", {"speech": cpu("100m", "10m")})
    policies = [policy(originals=before("speech")), policy("other", originals=before("slam"))]
    server = Server(risen, moved("slam"), policies=policies)
    code, out = restore(server)
    assert (code, [line.partition(":")[0] for line in out.splitlines()]) == (0, ["lab/slam/slam", "lab/speech/speech"])
    assert [pod for pod, _ in server.cluster.resizes()] == ["slam", "speech"]


def test_original_left_by_an_interrupted_restore_is_only_removed(restore: Any) -> None:
    server = Server(a_pod(), policies=[policy(originals=before("slam"))])
    assert restore(server) == (0, "lab/slam/slam: already restored\n")
    assert [call for call, *_ in server.cluster.calls] == ["store"]


def test_containers_without_originals_are_not_touched(restore: Any) -> None:
    ending = moved("speech", deletionTimestamp="2026-01-01T00:00:00Z")
    server = Server(a_pod(), ending, policies=[policy(originals=before("speech", "gone"))])
    assert restore(server) == (0, "nothing to restore\n")
    assert server.cluster.calls == []


def test_a_policy_restores_pods_of_its_own_namespace_only(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"), namespace="attack")])
    assert restore(server) == (0, "nothing to restore\n")
    assert server.cluster.limit("slam") == 990


def test_refusal_is_reported_and_other_pods_are_restored(restore: Any) -> None:
    server = Server(moved("slam"), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.cluster.faults.append(REFUSED)
    code, out = restore(server)
    assert code == 1
    assert out == "lab/slam/slam: NOT restored: Invalid: no (HTTP 422)\nlab/speech/speech: limit 990m -> 500m\n"
    assert server.cluster.originals("uid-slam")


def test_pod_deleted_during_restore_is_not_a_failure(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.cluster.faults.append(ActuationError("NotFound", "gone (HTTP 404)", retriable=False))
    assert restore(server)[0] == 0


def test_damaged_original_is_reported(restore: Any) -> None:
    code, out = restore(Server(moved(), policies=[policy(originals={"uid-slam": 1})]))
    assert code == 1
    assert out == "pod uid-slam: NOT restored: status.originals.uid-slam of lab/robot can't be read\n"


def test_only_our_finalizer_is_removed(restore: Any) -> None:
    server = Server(moved(), policies=[policy("robot", "example.com/backup", originals=before("slam"))])
    code, out = restore(server, "--remove-finalizers")
    assert code == 0
    assert out.splitlines()[1:] == ["ContextPolicy lab/robot: finalizer removed"]
    assert server.objects[0]["metadata"]["finalizers"] == ["example.com/backup"]
    assert restore(server, "--remove-finalizers") == (0, "nothing to restore\n")


def test_finalizers_stay_unless_asked_for(restore: Any) -> None:
    server = Server(policies=[policy()])
    assert restore(server) == (0, "nothing to restore\n")
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]


def test_policy_keeps_its_finalizer_until_all_containers_are_restored(restore: Any) -> None:
    server = Server(moved(), policies=[policy("robot", originals=before("slam")), policy("other")])
    server.cluster.faults.append(REFUSED)
    code, out = restore(server, "--remove-finalizers")
    assert code == 1
    assert out.splitlines()[1:] == [
        "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
        "ContextPolicy lab/other: finalizer removed",
    ]


def test_a_policy_that_changes_meanwhile_is_reported(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(policies=[policy()])
    old = [{"metadata": {**server.objects[0]["metadata"], "resourceVersion": "6"}}]
    monkeypatch.setattr(server, "policies", lambda _: old)
    code, out = restore(server, "--remove-finalizers")
    assert (code, out) == (1, "ContextPolicy lab/robot: NOT released: Conflict: changed (HTTP 409)\n")


def test_forbidden_namespace_does_not_block_the_others(restore: Any) -> None:
    far = moved("speech", namespace="far")
    policies = [policy(originals=before("slam")), policy("robot", originals=before("speech"), namespace="far")]
    server = Server(moved(), far, policies=policies)
    server.forbidden = {"closed"}
    code, out = restore(server, "--namespace=closed", "--namespace=lab", "--remove-finalizers")
    assert code == 2
    assert out.splitlines() == ["lab/slam/slam: limit 990m -> 500m", "ContextPolicy lab/robot: finalizer removed"]
    assert server.cluster.limit("speech") == 990


def test_a_dry_run_reports_the_same_and_does_nothing(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    code, out = restore(server, "--remove-finalizers", "--dry-run")
    assert (code, server.cluster.calls, server.objects[0]["metadata"]["finalizers"]) == (0, [], [FINALIZER])
    assert (0, out) == restore(server, "--remove-finalizers")


def test_json(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    code, out = restore(server, "--remove-finalizers", "--output", "json")
    container = {
        "container": "lab/slam/slam",
        "policy": "lab/robot",
        "moved": {"limit": "990m", "request": "100m"},
        "original": {"limit": "500m", "request": "100m"},
        "error": "",
        "note": "",
    }
    assert code == 0
    assert json.loads(out) == {
        "schemaVersion": 1,
        "containers": [container],
        "policies": [{"policy": "lab/robot", "error": ""}],
        "leftAlone": [],
        "unread": [],
    }


def test_heavy_policies_of_others_do_not_exhaust_the_memory(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    assert restore(server, "--dry-run")[0] == 0
    own, heavy = server.policies, PagedServer(100, a_heavy_policy)
    monkeypatch.setattr(server, "policies", lambda space: chain(own(space), items(heavy, "/policies")))
    assert peak(lambda: restore(server)) < 40 * MIB
    assert server.cluster.limit("slam") == 500


def test_heavy_pods_of_others_do_not_exhaust_the_memory(restore: Any) -> None:
    """The whole cluster's pods are listed, in a Job with 384 MiB."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    assert restore(server, "--dry-run")[0] == 0
    own = server.pods
    heavy = PagedServer(200, a_heavy_pod)
    server.pods = lambda namespace: chain(own(namespace), items(heavy, "/api/v1/pods"))  # type: ignore[method-assign]
    assert peak(lambda: restore(server)) < 40 * MIB
    assert server.cluster.limit("slam") == 500
