"""`contextpolicy restore` against an API server in memory."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.cli import main
from contextpolicy.cluster.api import FINALIZER
from contextpolicy.errors import ActuationError
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.cluster.builders import a_pod, cpu

if TYPE_CHECKING:
    from collections.abc import Sequence

BEFORE = {"request": "100m", "limit": "500m"}
REFUSED = ActuationError("Invalid", "no (HTTP 422)", retriable=False)


class Server:
    """The parts of the API that the command talks to."""

    def __init__(self, *pods: dict[str, Any], policies: Sequence[dict[str, Any]] = ()) -> None:
        self.cluster = FakeCluster(*pods)
        self.resize, self.write_originals = self.cluster.resize, self.cluster.write_originals
        self.objects = list(policies)
        for body in self.objects:
            self.cluster.policies[reference(body)] = body.pop("originals")
        self.forbidden: set[str] = set()
        self.closed = False

    def pods(self, namespace: str | None) -> list[dict[str, Any]]:
        return self._list(list(self.cluster.pods.values()), namespace)

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        found = self._list(self.objects, namespace)
        return [{**body, "status": {"originals": self.cluster.policies[reference(body)]}} for body in found]

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        (found,) = [p for p in self._list(self.objects, namespace) if p["metadata"]["name"] == name]
        if found["metadata"]["resourceVersion"] != version:
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
        monkeypatch.setattr("contextpolicy.cluster.api.ApiServer", lambda: server)
        code = main(["restore", *arguments])
        assert server.closed
        return code, capsys.readouterr().out

    return run


def test_a_container_is_put_back_before_its_note_goes(restore: Any) -> None:
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


def test_what_gives_cpu_back_comes_first(restore: Any) -> None:
    risen = a_pod("speech", {"speech": cpu("100m", "10m")})
    policies = [policy(originals=before("speech")), policy("other", originals=before("slam"))]
    server = Server(risen, moved("slam"), policies=policies)
    code, out = restore(server)
    assert (code, [line.partition(":")[0] for line in out.splitlines()]) == (0, ["lab/slam/slam", "lab/speech/speech"])
    assert [pod for pod, _ in server.cluster.resizes()] == ["slam", "speech"]


def test_a_note_left_by_an_interrupted_restore_is_only_taken_away(restore: Any) -> None:
    server = Server(a_pod(), policies=[policy(originals=before("slam"))])
    assert restore(server) == (0, "lab/slam/slam: already as it was\n")
    assert [call for call, *_ in server.cluster.calls] == ["store"]


def test_what_no_policy_moved_is_left_alone(restore: Any) -> None:
    ending = moved("speech", deletionTimestamp="2026-01-01T00:00:00Z")
    server = Server(a_pod(), ending, policies=[policy(originals=before("speech", "gone"))])
    assert restore(server) == (0, "nothing to restore\n")
    assert server.cluster.calls == []


def test_a_policy_restores_pods_of_its_own_namespace_only(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"), namespace="attack")])
    assert restore(server) == (0, "nothing to restore\n")
    assert server.cluster.limit("slam") == 990


def test_a_refusal_is_told_and_stops_nobody_else(restore: Any) -> None:
    server = Server(moved("slam"), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.cluster.faults.append(REFUSED)
    code, out = restore(server)
    assert code == 1
    assert out == "lab/slam/slam: NOT restored: Invalid: no (HTTP 422)\nlab/speech/speech: limit 990m -> 500m\n"
    assert server.cluster.originals("uid-slam")


def test_a_pod_that_goes_meanwhile_is_no_failure(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.cluster.faults.append(ActuationError("NotFound", "gone (HTTP 404)", retriable=False))
    assert restore(server)[0] == 0


def test_a_damaged_note_is_told(restore: Any) -> None:
    code, out = restore(Server(moved(), policies=[policy(originals={"uid-slam": 1})]))
    assert code == 1
    assert out == "pod uid-slam: NOT restored: status.originals.uid-slam of lab/robot can't be read\n"


def test_policies_are_released_and_other_finalizers_stay(restore: Any) -> None:
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


def test_a_policy_is_held_while_one_of_its_containers_is_not_back(restore: Any) -> None:
    server = Server(moved(), policies=[policy("robot", originals=before("slam")), policy("other")])
    server.cluster.faults.append(REFUSED)
    code, out = restore(server, "--remove-finalizers")
    assert code == 1
    assert out.splitlines()[1:] == [
        "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
        "ContextPolicy lab/other: finalizer removed",
    ]


def test_a_policy_that_changes_meanwhile_is_told(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(policies=[policy()])
    old = [{"metadata": {**server.objects[0]["metadata"], "resourceVersion": "6"}}]
    monkeypatch.setattr(server, "policies", lambda _: old)
    code, out = restore(server, "--remove-finalizers")
    assert (code, out) == (1, "ContextPolicy lab/robot: NOT released: Conflict: changed (HTTP 409)\n")


def test_namespaces_bound_it_and_one_that_is_closed_keeps_nobody_from_the_others(restore: Any) -> None:
    far = moved("speech", namespace="far")
    policies = [policy(originals=before("slam")), policy("robot", originals=before("speech"), namespace="far")]
    server = Server(moved(), far, policies=policies)
    server.forbidden = {"closed"}
    code, out = restore(server, "--namespace=closed", "--namespace=lab", "--remove-finalizers")
    assert code == 1
    assert out.splitlines() == [
        "closed: NOT restored: Forbidden: you may not (HTTP 403)",
        "lab/slam/slam: limit 990m -> 500m",
        "ContextPolicy closed: NOT released: Forbidden: you may not (HTTP 403)",
        "ContextPolicy lab/robot: finalizer removed",
    ]
    assert server.cluster.limit("speech") == 990


def test_a_dry_run_tells_the_same_and_does_nothing(restore: Any) -> None:
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
    }
    assert code == 0
    assert json.loads(out) == {"containers": [container], "policies": [{"policy": "lab/robot", "error": ""}]}


def test_no_cluster(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", str(tmp_path / "none"))
    monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)
    assert main(["restore"]) == 2
    assert "set KUBECONFIG" in capsys.readouterr().err
