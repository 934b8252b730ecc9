"""All access to the API server: what is read, patched and created there."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any, NamedTuple

import urllib3

from contextpolicy.cluster import lease, paging
from contextpolicy.cluster.api_connection import JSON, ApiConnection, excerpt
from contextpolicy.cluster.lease import Lease
from contextpolicy.cluster.nesting import loads
from contextpolicy.cluster.paging import Page
from contextpolicy.cluster.pod_parsing import version_of
from contextpolicy.cluster.serving import Service, service
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import API, PLURAL, path_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.cluster.api_connection import AnswerListener, Kubeconfig

STRATEGIC = "application/strategic-merge-patch+json"
MERGE = "application/merge-patch+json"
WATCH_SECONDS = 300
"""Seconds after which the server ends a watch, which is then resumed."""


class Secret(NamedTuple):
    """The files of a Secret by name, and its version."""

    files: Mapping[str, bytes]
    version: str


class ApiServer:
    """Safe to use from several threads."""

    def __init__(self, listener: AnswerListener, kubeconfig: Kubeconfig | None = None) -> None:
        """Find the cluster as kubectl does: what is named, else the pod's service account, else KUBECONFIG."""
        self._connection = ApiConnection(listener, kubeconfig)

    @property
    def address(self) -> str:
        """The server's URL."""
        return self._connection.address

    def close(self) -> None:
        """Close the connections."""
        self._connection.close()

    def serves_policies(self) -> bool:
        """Whether the custom resource definition is installed."""
        try:
            self.read(API)
        except ActuationError as error:
            if error.reason == "NotFound":
                return False
            raise
        return True

    def resize(self, namespace: str, pod: str, patch: Mapping[str, Any], manager: str) -> int:
        """PATCH pods/resize as this field manager: containers merge by name.

        Returns the changed pod's resourceVersion, 0 if not a number.
        """
        path = f"/api/v1/namespaces/{namespace}/pods/{pod}/resize"
        return _version(self._connection.send("PATCH", path, patch, STRATEGIC, manager=manager))

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        """GET a pod."""
        return self.read(f"/api/v1/namespaces/{namespace}/pods/{name}")

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> int:
        """Merge into `status.originals` of a ContextPolicy; None removes an entry. Returns its resourceVersion."""
        return _version(self._write_status(namespace, policy, {"originals": dict(changes)}))

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """Merge into the status of a ContextPolicy; None removes a field."""
        self._write_status(namespace, name, status)

    def change_policy(self, namespace: str, name: str, spec: Mapping[str, Any]) -> None:
        """Merge into the spec of a ContextPolicy; None removes a field."""
        path = path_of(namespace, name)
        self._connection.send("PATCH", path, {"spec": dict(spec)}, MERGE)

    def delete_policy(self, namespace: str, name: str) -> None:
        """Delete a ContextPolicy; its finalizer keeps it until its containers are restored."""
        self._connection.send("DELETE", path_of(namespace, name), None, JSON)

    def may(self, user: str, right: Mapping[str, str]) -> bool:
        """Whether a user has a right, as the attributes of a SubjectAccessReview."""
        review = {
            "apiVersion": "authorization.k8s.io/v1",
            "kind": "SubjectAccessReview",
            "spec": {"user": user, "resourceAttributes": dict(right)},
        }
        path = "/apis/authorization.k8s.io/v1/subjectaccessreviews"
        answer = _object(self._connection.send("POST", path, review, JSON), "status")
        return bool(answer["status"].get("allowed"))

    def read_text(self, path: str) -> str:
        """GET a resource that is not a JSON object, such as a kubelet's metrics."""
        return self._connection.send("GET", path, None, JSON).decode(errors="replace")

    def read(self, path: str, *needed: str) -> dict[str, Any]:
        """GET an object or a list; ActuationError where it lacks one of the `needed` fields."""
        return _object(self._connection.send("GET", path, None, JSON), *needed)

    def items(self, path: str) -> list[dict[str, Any]]:
        """GET the objects of a list."""
        return list(paging.items(self, path))

    def read_page(self, path: str, most: int | None) -> Page | None:
        """GET a part of a list; None if it has more bytes than `most`."""
        answer = self._connection.send_up_to(path, most)
        return None if answer is None else Page(_object(answer, "items"), len(answer))

    def watch(self, path: str, version: str) -> urllib3.BaseHTTPResponse:
        """The changes of a list since `version`, one JSON object per line; the caller closes the response.

        The path may select objects: `...?fieldSelector=metadata.name=slam`.
        """
        query = f"watch=true&allowWatchBookmarks=true&timeoutSeconds={WATCH_SECONDS}&resourceVersion={version}"
        join = "&" if "?" in path else "?"
        return self._connection.stream(f"{path}{join}{query}")

    def pods(self, namespace: str | None) -> Iterator[dict[str, Any]]:
        """The pods of a namespace, or of all (None), as they are read: together they may be too large to be kept."""
        return paging.items(self, _list_path("/api/v1", namespace, "pods"))

    def policies(self, namespace: str | None) -> Iterator[dict[str, Any]]:
        """The ContextPolicy objects of a namespace, or of all (None), as they are read, for the same reason.

        NotFound if their definition is not installed.
        """
        return paging.items(self, _list_path(API, namespace, PLURAL))

    def config_map(self, namespace: str, name: str) -> dict[str, str]:
        """The data of a ConfigMap."""
        data: dict[str, str] = self.read(f"/api/v1/namespaces/{namespace}/configmaps/{name}").get("data") or {}
        return data

    def secret(self, namespace: str, name: str) -> Secret:
        """The files of a Secret; ValueError where they are not in base64."""
        found = self.read(f"/api/v1/namespaces/{namespace}/secrets/{name}", "metadata")
        files = {file: base64.b64decode(content) for file, content in (found.get("data") or {}).items()}
        return Secret(files, str(found["metadata"]["resourceVersion"]))

    def write_secret(self, namespace: str, name: str, files: Mapping[str, bytes], version: str) -> None:
        """Merge files into a Secret that exists; Conflict when it has changed since `version`."""
        data = {file: base64.b64encode(content).decode() for file, content in files.items()}
        path = f"/api/v1/namespaces/{namespace}/secrets/{name}"
        self._connection.send("PATCH", path, {"metadata": {"resourceVersion": version}, "data": data}, MERGE)

    def delete_secret(self, namespace: str, name: str) -> None:
        """Delete a Secret."""
        self._connection.send("DELETE", f"/api/v1/namespaces/{namespace}/secrets/{name}", None, JSON)

    def lease(self, namespace: str, name: str) -> Lease:
        """GET a Lease; one that is not there is an empty one."""
        try:
            return lease.read(self.read(_lease_path(namespace, name)))
        except ActuationError as error:
            if error.reason == "NotFound":
                return Lease()
            raise

    def service(self, namespace: str) -> Service:
        """Whether an operator serves the namespace, as far as we may read its Lease."""
        try:
            answer, now = self._connection.dated(_lease_path(namespace, lease.NAMESPACE_LEASE))
        except ActuationError as error:
            if error.reason not in ("NotFound", "Forbidden"):
                raise
            return Service(served=False if error.reason == "NotFound" else None)
        return service(_object(answer, "metadata"), now)

    def write_lease(self, namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        """Create a Lease, or replace the one of the same version; Conflict when it is not as it was.

        `timeout` is how long to wait for the answer, in seconds.
        """
        path, body = _lease_path(namespace, name), lease.write(content, namespace, name)
        method, target = ("PUT", path) if content.version else ("POST", path.rpartition("/")[0])
        patience = urllib3.Timeout(total=timeout)
        return lease.read(_object(self._connection.send(method, target, body, JSON, patience)))

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace the finalizers of a ContextPolicy; Conflict when it has changed since `version`."""
        metadata = {"finalizers": list(finalizers), "resourceVersion": version}
        self._connection.send("PATCH", path_of(namespace, name), {"metadata": metadata}, MERGE)

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """Create an Event."""
        self._connection.send("POST", f"/api/v1/namespaces/{namespace}/events", event, JSON)

    def _write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> bytes:
        path = f"{path_of(namespace, name)}/status"
        return self._connection.send("PATCH", path, {"status": dict(status)}, MERGE)


def _list_path(root: str, namespace: str | None, plural: str) -> str:
    return f"{root}/{plural}" if namespace is None else f"{root}/namespaces/{namespace}/{plural}"


def _lease_path(namespace: str, name: str) -> str:
    return f"/apis/coordination.k8s.io/v1/namespaces/{namespace}/leases/{name}"


def _version(answer: bytes) -> int:
    try:
        return version_of(_object(answer, "metadata")["metadata"])
    except (ValueError, TypeError, AttributeError) as error:
        raise _unreadable(answer) from error


def _object(answer: bytes, *needed: str) -> dict[str, Any]:
    try:
        found = loads(answer)
    except ValueError as error:
        raise _unreadable(answer) from error
    if not isinstance(found, dict) or any(field not in found for field in needed):
        raise _unreadable(answer)
    return found


def _unreadable(answer: bytes) -> ActuationError:
    message = f"expected the JSON object that was requested: {excerpt(answer)}"
    return ActuationError("Unreadable", message, retriable=True, in_doubt=True)
