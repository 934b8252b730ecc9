"""`contextpolicy restore` against an API server in memory."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.actuators.resize.stored_originals import Signatures, StoredPod, write
from contextpolicy.cli import main
from contextpolicy.cluster.api import Secret
from contextpolicy.cluster.lease import Lease
from contextpolicy.cluster.paging import items
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.actuators.resize.test_vetting import OWNER, PATH, an_owner
from tests.cluster.builders import a_pod, cpu
from tests.cluster.paged_server import MIB, PagedServer, a_heavy_pod, a_heavy_policy, peak
from tests.policies.builders import a_policy

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

BEFORE = {"request": "100m", "limit": "500m"}
REFUSED = ActuationError("Invalid", "no (HTTP 422)", retriable=False)


class Server:
    """The parts of the API that the command talks to."""

    def __init__(self, *pods: dict[str, Any], policies: Sequence[dict[str, Any]] = ()) -> None:
        self.cluster = FakeCluster(*pods)
        self.resize, self.write_originals = self.cluster.resize, self.cluster.write_originals
        self.read = self.cluster.read
        self.secrets: dict[str, Secret] = {}
        self.objects = list(policies)
        for body in self.objects:
            self.cluster.policies[reference(body)] = body.pop("originals")
        self.forbidden: set[str] = set()
        self.leases: dict[str, Lease] = {}
        self.renewals: list[str] = []
        self.closed = False
        self.conflicts = 0

    def lease(self, namespace: str, name: str) -> Lease:
        assert name == "contextpolicy"
        return self.leases.get(namespace, Lease())

    def write_lease(self, namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        assert (name, timeout > 0) == ("contextpolicy", True)
        before = self.lease(namespace, name)
        if before.version != content.version:
            raise ActuationError("Conflict", "changed (HTTP 409)", retriable=True)
        self.leases[namespace] = replace(content, version=str(int(before.version) + 1))
        self.renewals.append(namespace)
        return self.leases[namespace]

    def pods(self, namespace: str | None) -> Iterable[dict[str, Any]]:
        return self._list(list(self.cluster.pods.values()), namespace)

    def policies(self, namespace: str | None) -> Iterable[dict[str, Any]]:
        found = self._list(self.objects, namespace)
        return [{**body, "status": {"originals": self.cluster.policies[reference(body)]}} for body in found]

    def secret(self, namespace: str, name: str) -> Secret:
        try:
            return self.secrets[f"{namespace}/{name}"]
        except KeyError:
            raise ActuationError("NotFound", "no such Secret (HTTP 404)", retriable=False) from None

    def delete_secret(self, namespace: str, name: str) -> None:
        del self.secrets[f"{namespace}/{name}"]

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        (found,) = [p for p in self._list(self.objects, namespace) if p["metadata"]["name"] == name]
        if self.conflicts or found["metadata"]["resourceVersion"] != version:
            self.conflicts = max(0, self.conflicts - 1)
            raise ActuationError("Conflict", "changed (HTTP 409)", retriable=True)
        found["metadata"]["finalizers"] = list(finalizers)

    def close(self) -> None:
        self.closed = True

    def _list(self, objects: list[dict[str, Any]], namespace: str | None) -> list[dict[str, Any]]:
        if namespace in self.forbidden:
            raise ActuationError("Forbidden", "you may not (HTTP 403)", retriable=False)
        return [one for one in objects if namespace in (None, one["metadata"]["namespace"])]


def reference(body: dict[str, Any]) -> str:
    return f"{body['metadata']['namespace']}/{body['metadata']['name']}"


def moved(name: str = "slam", **metadata: Any) -> dict[str, Any]:
    """A pod whose container has 990m by order of a policy, and had 500m."""
    return a_pod(name, {name: cpu("100m", "990m")}, **metadata)


def before(*names: str, **containers: dict[str, str]) -> dict[str, Any]:
    """What a status says about pods with one container of 500m each, and about the containers of slam."""
    found = {f"uid-{name}": {"pod": name, "containers": {name: BEFORE}} for name in names}
    return found | ({"uid-slam": {"pod": "slam", "containers": containers}} if containers else {})


def policy(name: str = "robot", *finalizers: str, originals: object = None, namespace: str = "lab") -> dict[str, Any]:
    found = [FINALIZER, *finalizers]
    metadata = {"namespace": namespace, "name": name, "resourceVersion": "7", "finalizers": found}
    return {"metadata": metadata, "originals": {} if originals is None else originals}


@pytest.fixture
def restore(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run the command; returns the exit code and what it printed."""

    def run(server: Server, *arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("contextpolicy.cluster.api.ApiServer", lambda *_: server)
        code = main(["restore", *arguments])
        assert server.closed
        return code, capsys.readouterr().out

    return run


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


FIRST = Lease(holder="blue/contextpolicy", seconds=30, renewed="1", version="8")
GREEN = replace(FIRST, holder="green/contextpolicy")
KEY = b"k" * 32
SECRETS = {"green/contextpolicy-originals": Secret({"key": KEY}, "1")}
RELEASE = "--release=green/contextpolicy"


def by_us(name: str = "slam") -> dict[str, Any]:
    """A pod whose container has 990m by order of a policy, as the API server recorded."""
    fields: dict[str, Any] = {
        "f:spec": {"f:containers": {f'k:{{"name":"{name}"}}': {"f:resources": {"f:limits": {"f:cpu": {}}}}}}
    }
    return moved(name, managedFields=[{"manager": "contextpolicy", "time": "2026", "fieldsV1": fields}])


def signed(limit: int, by: str = "lab/robot") -> dict[str, Any]:
    entry = StoredPod("slam", {"slam": Cpu(100, limit)})
    return {"uid-slam": write(entry._replace(signature=Signatures(KEY).of(by, "uid-slam", entry)))}


def with_spec(body: dict[str, Any]) -> dict[str, Any]:
    """The policy with tasks that select slam and speech."""
    return {**body, "spec": a_policy()["spec"]}


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
    """A tenant's policies of 1.4 MB took the Job 12 s each; it has 240 s to restore what all namespaces had."""
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


def test_heavy_policies_of_others_do_not_exhaust_the_memory(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    assert restore(server, "--dry-run")[0] == 0
    own, heavy = server.policies, PagedServer(100, a_heavy_policy)
    monkeypatch.setattr(server, "policies", lambda space: chain(own(space), items(heavy, "/policies")))
    assert peak(lambda: restore(server)) < 40 * MIB
    assert server.cluster.limit("slam") == 500


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


def two_namespaces() -> Server:
    """A release `blue` serves lab; far is served by `green`."""
    far = moved("speech", namespace="far")
    policies = [policy(originals=before("slam")), policy("robot", originals=before("speech"), namespace="far")]
    server = Server(moved(), far, policies=policies)
    server.leases = {"lab": FIRST, "far": replace(FIRST, holder="green/contextpolicy")}
    return server


def test_namespace_of_another_release_is_skipped_even_while_it_is_down(restore: Any) -> None:
    server = two_namespaces()
    code, out = restore(server, "--remove-finalizers", "--release=green/contextpolicy")
    assert code == 0
    assert out.splitlines() == [
        "namespace lab: served by blue/contextpolicy, left alone",
        "far/speech/speech: limit 990m -> 500m",
        "ContextPolicy far/robot: finalizer removed",
    ]
    assert server.cluster.limit("slam") == 990
    assert server.cluster.policies["lab/robot"] == before("slam")
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]


@pytest.mark.parametrize("times", [1, 9])
def test_lease_that_can_not_be_renewed_keeps_no_other_namespace_from_being_restored(
    restore: Any, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    """Anyone who may write Leases in a namespace can make one that the API server takes from nobody else."""
    server = two_namespaces()
    server.leases["lab"] = GREEN
    write_lease, refusals = server.write_lease, [REFUSED] * times

    def refuse(namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        if namespace == "lab" and refusals:
            raise refusals.pop()
        return write_lease(namespace, name, content, timeout)

    monkeypatch.setattr(server, "write_lease", refuse)
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert code == 2
    assert (server.cluster.limit("speech"), server.cluster.limit("slam")) == (500, 990)
    assert {reference(body): body["metadata"]["finalizers"] for body in server.objects} == {
        "lab/robot": [FINALIZER],
        "far/robot": [],
    }
    assert "ContextPolicy lab/robot: NOT released" in out


def test_namespace_taken_by_another_release_keeps_its_finalizers(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.leases = {"lab": replace(FIRST, holder="green/contextpolicy")}
    resize = server.resize

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    server.resize = lose
    code, out = restore(server, "--remove-finalizers", "--release=green/contextpolicy")
    assert (code, out) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]


def test_a_release_keeps_its_lease_while_it_restores(restore: Any) -> None:
    """It would run out, and the next release would take containers for its own that are still to be put back."""
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    assert restore(server, RELEASE)[0] == 0
    assert len(server.renewals) >= 2
    assert server.leases["lab"].renewed > "2026"


def test_lease_that_is_deleted_while_it_is_renewed_is_nobodys(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """As anyone may who may delete Leases there: the Job failed, or took what it had not restored for gone."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.leases = {"lab": GREEN}

    def write_lease(*_: object) -> Lease:
        server.leases = {}
        raise ActuationError("NotFound", "no such Lease (HTTP 404)", retriable=False)

    monkeypatch.setattr(server, "write_lease", write_lease)
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.cluster.limit("slam") == 500


def test_restore_stops_when_another_release_takes_the_namespace(restore: Any) -> None:
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    resize = server.resize

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    server.resize = lose
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()) == (
        0,
        [
            "namespace lab: served by blue/contextpolicy, left alone",
            "lab/slam/slam: limit 990m -> 500m",
        ],
    )
    assert server.cluster.limit("speech") == 990
    assert server.cluster.policies["lab/robot"].keys() == {"uid-speech"}


def test_finalizers_stay_where_another_release_was_in_the_middle(restore: Any) -> None:
    """It has given the namespace back when finalizers are removed, but a container was left alone."""
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    resize, policies = server.resize, server.policies

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    def get_back(namespace: str | None) -> Iterable[dict[str, Any]]:
        if server.cluster.calls:
            server.leases = {"lab": GREEN}
        return policies(namespace)

    server.resize, server.policies = lose, get_back  # type: ignore[method-assign]
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()[-1]) == (
        1,
        "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
    )
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]
    server.resize = resize
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.cluster.limit("speech") == 500


def test_key_stays_while_another_release_has_originals_that_it_signed(restore: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=signed(500))])
    server.secrets, server.leases = dict(SECRETS), {"lab": FIRST}
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert (server.cluster.limit("slam"), server.secrets) == (990, SECRETS)


def test_key_goes_although_another_release_serves_a_namespace(restore: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=before("slam"))])
    server.secrets, server.leases = dict(SECRETS), {"lab": FIRST}
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.secrets == {}


def test_leases_without_a_holder_are_waited_for_at_once_and_not_for_long(
    restore: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody may leave one in each of the namespaces, and the Job has four minutes."""
    names = [f"lab-{index}" for index in range(4)]
    server = Server(policies=[policy(namespace=name) for name in names])
    server.leases = {name: Lease(seconds=60, renewed="1", version="8") for name in names}
    waits: list[float] = []
    monkeypatch.setattr("time.sleep", waits.append)
    code, out = restore(server, *(f"--namespace={name}" for name in names), "--remove-finalizers", RELEASE)
    assert (code, out.count("finalizer removed")) == (0, 4)
    assert 25 <= sum(waits) <= 27


def test_lease_that_could_not_be_read_at_first_is_an_error(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody has waited for it."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    read, failures = server.lease, [REFUSED, REFUSED]

    def lease(namespace: str, name: str) -> Lease:
        if failures:
            raise failures.pop()
        return read(namespace, name)

    monkeypatch.setattr(server, "lease", lease)
    assert (restore(server, RELEASE)[0], server.cluster.calls) == (2, [])


def test_deleted_lease_may_be_recreated_by_its_holder(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if sum(waits) == 10:
            server.leases["lab"] = FIRST

    monkeypatch.setattr("time.sleep", wait)
    assert restore(server, "--remove-finalizers", RELEASE) == (
        0,
        "namespace lab: served by blue/contextpolicy, left alone\n",
    )
    assert sum(waits) == 10


def test_wait_for_a_deleted_lease_is_bounded(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    waits: list[float] = []
    monkeypatch.setattr("time.sleep", waits.append)
    assert restore(server, RELEASE) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert 25 <= sum(waits) <= 27


def test_heavy_pods_of_others_do_not_exhaust_the_memory(restore: Any) -> None:
    """The whole cluster's pods are listed, in a Job with 384 MiB."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    assert restore(server, "--dry-run")[0] == 0
    own = server.pods
    heavy = PagedServer(200, a_heavy_pod)
    server.pods = lambda namespace: chain(own(namespace), items(heavy, "/api/v1/pods"))  # type: ignore[method-assign]
    assert peak(lambda: restore(server)) < 40 * MIB
    assert server.cluster.limit("slam") == 500


def test_manual_restore_skips_namespaces_of_a_running_operator(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Green is gone, and its Lease with nobody to renew it."""
    server = two_namespaces()
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if sum(waits) == 10:
            server.leases["lab"] = replace(FIRST, renewed="2", version="9")

    monkeypatch.setattr("time.sleep", wait)
    code, out = restore(server, "--output", "json")
    reported = json.loads(out)
    assert (code, reported["leftAlone"]) == (0, [{"namespace": "lab", "servedBy": "blue/contextpolicy"}])
    assert [one["container"] for one in reported["containers"]] == ["far/speech/speech"]
    assert 30 <= sum(waits) <= 32, "for as long as a Lease lasts, once for all namespaces"


def test_unreadable_lease_changes_nothing(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])

    def refuse(*_: str) -> Lease:
        raise REFUSED

    monkeypatch.setattr(server, "lease", refuse)
    code, out = restore(server, "--remove-finalizers")
    assert (code, server.cluster.calls) == (2, [])
    assert out == "ContextPolicy lab/robot: NOT released: Invalid: no (HTTP 422)\n"
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]
