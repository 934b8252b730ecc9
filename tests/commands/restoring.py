"""An API server in memory for `contextpolicy restore`, and what is on it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.stored_originals import Signatures, StoredPod, write
from contextpolicy.cluster.api import Secret
from contextpolicy.cluster.lease import Lease
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.cluster.builders import a_pod, cpu
from tests.policies.builders import a_policy

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

BEFORE = {"request": "100m", "limit": "500m"}
REFUSED = ActuationError("Invalid", "no (HTTP 422)", retriable=False)
FIRST = Lease(holder="blue/contextpolicy", seconds=30, renewed="1", version="8")
GREEN = replace(FIRST, holder="green/contextpolicy")
KEY = b"k" * 32
SECRETS = {"green/contextpolicy-originals": Secret({"key": KEY}, "1")}
RELEASE = "--release=green/contextpolicy"


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


def two_namespaces() -> Server:
    """A release `blue` serves lab; far is served by `green`."""
    far = moved("speech", namespace="far")
    policies = [policy(originals=before("slam")), policy("robot", originals=before("speech"), namespace="far")]
    server = Server(moved(), far, policies=policies)
    server.leases = {"lab": FIRST, "far": replace(FIRST, holder="green/contextpolicy")}
    return server
