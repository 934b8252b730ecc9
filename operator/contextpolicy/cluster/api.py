"""The one door to the API server: patches and events through a pooled client; its answers become our errors.

The hot patch bypasses the client's models: the answer, a whole pod, is read and thrown away.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import urllib3
from kubernetes import client, config

from contextpolicy.cluster.pods import version_of
from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

STRATEGIC = "application/strategic-merge-patch+json"
MERGE = "application/merge-patch+json"
FINALIZER = "contextpolicy.dev/restore"
"""Holds a ContextPolicy that is being deleted until its containers are as they were."""
TIMEOUT = (2.0, 5.0)
"""Seconds to connect and to wait for an answer."""

_REASONS = {
    400: ("BadRequest", False),
    401: ("Unauthorized", True),
    403: ("Forbidden", False),
    404: ("NotFound", False),
    409: ("Conflict", True),
    422: ("Invalid", False),
    429: ("TooManyRequests", True),
}


class Api:
    """A pooled client; safe to use from several threads."""

    def __init__(self, pool: int = 8) -> None:
        """Find the cluster as kubectl does: the pod's service account, else KUBECONFIG."""
        _configure()
        settings = client.Configuration.get_default_copy()
        settings.connection_pool_maxsize = pool
        settings.retries = urllib3.Retry(0)
        self._client = client.ApiClient(settings)

    def close(self) -> None:
        """Give the connections back."""
        self._client.rest_client.pool_manager.clear()

    def serves_policies(self) -> bool:
        """Whether the custom resource is installed."""
        try:
            self._send("GET", "/apis/contextpolicy.dev/v1alpha1", None, "application/json")
        except ActuationError as error:
            if error.reason == "NotFound":
                return False
            raise
        return True

    def resize(self, namespace: str, pod: str, patch: Mapping[str, Any]) -> int:
        """PATCH pods/resize: containers merge by name. Returns the version of the pod that has it."""
        return _version(self._send("PATCH", f"/api/v1/namespaces/{namespace}/pods/{pod}/resize", patch, STRATEGIC))

    def annotate(self, namespace: str, pod: str, annotations: Mapping[str, str | None]) -> int:
        """Set annotations of a pod; None removes one. Returns the version of the pod that has it."""
        patch = {"metadata": {"annotations": dict(annotations)}}
        return _version(self._send("PATCH", f"/api/v1/namespaces/{namespace}/pods/{pod}", patch, MERGE))

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """Replace what the status of a ContextPolicy says; fields that are absent now are removed by None."""
        path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}/status"
        self._send("PATCH", path, {"status": dict(status)}, MERGE)

    def pods(self, namespace: str | None) -> list[dict[str, Any]]:
        """The pods of a namespace; of all when it is None."""
        return self._list("/api/v1", namespace, "pods")

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        """The ContextPolicy objects of a namespace; of all when it is None; none where their definition is missing."""
        try:
            return self._list("/apis/contextpolicy.dev/v1alpha1", namespace, "contextpolicies")
        except ActuationError as error:
            if error.reason == "NotFound":
                return []
            raise

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace the finalizers of a ContextPolicy; Conflict when it has changed since `version`."""
        path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}"
        self._send("PATCH", path, {"metadata": {"finalizers": list(finalizers), "resourceVersion": version}}, MERGE)

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """Create an Event."""
        self._send("POST", f"/api/v1/namespaces/{namespace}/events", event, "application/json")

    def _list(self, root: str, namespace: str | None, plural: str) -> list[dict[str, Any]]:
        path = f"{root}/{plural}" if namespace is None else f"{root}/namespaces/{namespace}/{plural}"
        found: list[dict[str, Any]] = json.loads(self._send("GET", path, None, "application/json"))["items"]
        return found

    def _send(self, method: str, path: str, body: Mapping[str, Any] | None, content_type: str) -> bytes:
        request = self._client.param_serialize(
            method=method,
            resource_path=path,
            query_params=[("fieldManager", FIELD_MANAGER)],
            header_params={"Accept": "application/json", "Content-Type": content_type},
            body=None if body is None else dict(body),
            auth_settings=["BearerToken"],
        )
        try:
            response = self._client.call_api(*request, _request_timeout=TIMEOUT)
            answer = response.read()  # type: ignore[no-untyped-call]
        except (client.ApiException, urllib3.exceptions.HTTPError, OSError) as error:
            raise ActuationError("Unreachable", f"{method} {path}: {error}", retriable=True) from error
        if response.status >= 300:
            raise _refusal(response.status, answer, response.headers.get("Retry-After"))
        return bytes(answer)


def _configure() -> None:
    try:
        config.load_incluster_config()  # type: ignore[no-untyped-call]
    except config.ConfigException:
        try:
            config.load_kube_config()  # type: ignore[no-untyped-call]
        except config.ConfigException as error:
            raise ActuationError("NoCluster", f"no cluster: {error}; set KUBECONFIG", retriable=False) from error


def _version(answer: bytes) -> int:
    try:
        return version_of(json.loads(answer)["metadata"])
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"the answer is no pod: {answer[:200].decode(errors='replace')}"
        raise ActuationError("Unreadable", message, retriable=True) from error


def _refusal(status: int, answer: bytes, retry_after: str | None) -> ActuationError:
    reason, retriable = _REASONS.get(status, ("ServerError" if status >= 500 else "Refused", status >= 500))
    try:
        message = json.loads(answer).get("message", "")
    except (ValueError, AttributeError):
        message = answer[:200].decode(errors="replace")
    text = f"{message or 'no message'} (HTTP {status})"
    pause = float(retry_after) if retry_after and retry_after.isdecimal() else 0.0  # the API server writes no dates
    return ActuationError(reason, text, retriable=retriable, retry_after=pause)
