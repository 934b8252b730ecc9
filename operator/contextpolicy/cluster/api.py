"""The one door to the API server: reads, patches and events over pooled connections; its errors become ours.

The client library finds the cluster and manages tokens and connections. Its models and serializers are not used: they
would take a third of the operator's own time on the hot path, and a patched pod matters only for its version.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import urllib3
from kubernetes import client, config

from contextpolicy.cluster import lease
from contextpolicy.cluster.lease import Lease
from contextpolicy.cluster.pods import version_of
from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

JSON = "application/json"
STRATEGIC = "application/strategic-merge-patch+json"
MERGE = "application/merge-patch+json"
POOL = 16
"""Connections kept open for patch workers, reporter and watches: a new one costs a TLS handshake."""
FINALIZER = "contextpolicy.dev/restore"
"""Keeps a deleted ContextPolicy until its containers are restored."""
TIMEOUT = urllib3.Timeout(connect=2.0, read=5.0)
"""Seconds to wait for a connection and for an answer."""
HEARTBEAT = urllib3.Timeout(connect=2.0, read=90.0)
"""Seconds that a watch may be silent: the server sends a bookmark every minute (KEP-956)."""
WATCH_SECONDS = 300
"""Seconds after which the server ends a watch, which is then resumed."""

_REASONS = {
    400: ("BadRequest", False),
    401: ("Unauthorized", True),
    403: ("Forbidden", False),
    404: ("NotFound", False),
    409: ("Conflict", True),
    422: ("Invalid", False),
    429: ("TooManyRequests", True),
}


class ApiServer:
    """A pooled client; safe to use from several threads."""

    def __init__(self, on_answer: Callable[[str, str], object] | None = None) -> None:
        """Find the cluster as kubectl does: the pod's service account, else KUBECONFIG.

        `on_answer` is called with the HTTP method and the status code of each answer, or `none` if there was none.
        """
        self._on_answer = on_answer
        _configure()
        settings = client.Configuration.get_default_copy()
        settings.connection_pool_maxsize = POOL
        # Callers retry: by then a newer plan may want something else.
        settings.retries = urllib3.Retry(0)
        self._client = client.ApiClient(settings)
        self._pool = self._client.rest_client.pool_manager.connection_from_url(settings.host)
        self._prefix = (urllib3.util.parse_url(settings.host).path or "").rstrip("/")

    def close(self) -> None:
        """Close the connections."""
        self._client.rest_client.pool_manager.clear()

    def serves_policies(self) -> bool:
        """Whether the custom resource definition is installed."""
        try:
            self.read("/apis/contextpolicy.dev/v1alpha1")
        except ActuationError as error:
            if error.reason == "NotFound":
                return False
            raise
        return True

    def resize(self, namespace: str, pod: str, patch: Mapping[str, Any]) -> int:
        """PATCH pods/resize: containers merge by name. Returns the changed pod's resourceVersion, 0 if not a number."""
        return _version(self._send("PATCH", f"/api/v1/namespaces/{namespace}/pods/{pod}/resize", patch, STRATEGIC))

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        """GET a pod."""
        return self.read(f"/api/v1/namespaces/{namespace}/pods/{name}")

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> None:
        """Merge into `status.originals` of a ContextPolicy; None removes an entry."""
        self.write_status(namespace, policy, {"originals": dict(changes)})

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """Merge into the status of a ContextPolicy; None removes a field."""
        path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}/status"
        self._send("PATCH", path, {"status": dict(status)}, MERGE)

    def change_policy(self, namespace: str, name: str, spec: Mapping[str, Any]) -> None:
        """Merge into the spec of a ContextPolicy; None removes a field."""
        path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}"
        self._send("PATCH", path, {"spec": dict(spec)}, MERGE)

    def delete_policy(self, namespace: str, name: str) -> None:
        """Delete a ContextPolicy; its finalizer keeps it until its containers are restored."""
        self._send(
            "DELETE", f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}", None, JSON
        )

    def may(self, user: str, right: Mapping[str, str]) -> bool:
        """Whether somebody has a right, as the attributes of a SubjectAccessReview."""
        review = {
            "apiVersion": "authorization.k8s.io/v1",
            "kind": "SubjectAccessReview",
            "spec": {"user": user, "resourceAttributes": dict(right)},
        }
        answer = json.loads(self._send("POST", "/apis/authorization.k8s.io/v1/subjectaccessreviews", review, JSON))
        return bool(answer["status"].get("allowed"))

    def read_text(self, path: str) -> str:
        """GET something that is no object, such as a kubelet's metrics."""
        return self._send("GET", path, None, JSON).decode(errors="replace")

    def read(self, path: str) -> dict[str, Any]:
        """GET an object or a list."""
        found: dict[str, Any] = json.loads(self._send("GET", path, None, JSON))
        return found

    def watch(self, path: str, version: str) -> urllib3.BaseHTTPResponse:
        """The changes of a list since `version`, one JSON object per line; the caller closes the response.

        The path may select objects: `...?fieldSelector=metadata.name=slam`.
        """
        query = f"watch=true&allowWatchBookmarks=true&timeoutSeconds={WATCH_SECONDS}&resourceVersion={version}"
        join = "&" if "?" in path else "?"
        response = self._request("GET", f"{path}{join}{query}", None, timeout=HEARTBEAT, preload_content=False)
        if response.status >= 300:
            raise _refusal(response)
        return response

    def pods(self, namespace: str | None) -> list[dict[str, Any]]:
        """The pods of a namespace, or of all (None)."""
        return self._list("/api/v1", namespace, "pods")

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        """The ContextPolicy objects of a namespace, or of all (None); none if their definition is not installed."""
        try:
            return self._list("/apis/contextpolicy.dev/v1alpha1", namespace, "contextpolicies")
        except ActuationError as error:
            if error.reason == "NotFound":
                return []
            raise

    def config_map(self, namespace: str, name: str) -> dict[str, str]:
        """The data of a ConfigMap."""
        data: dict[str, str] = self.read(f"/api/v1/namespaces/{namespace}/configmaps/{name}").get("data") or {}
        return data

    def lease(self, namespace: str, name: str) -> Lease:
        """GET a Lease; one that is not there is an empty one."""
        try:
            return lease.read(self.read(_lease_path(namespace, name)))
        except ActuationError as error:
            if error.reason == "NotFound":
                return Lease()
            raise

    def write_lease(self, namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        """Create a Lease, or replace the one of the same version; Conflict when it is not as it was.

        `timeout` is how long to wait for the answer, in seconds.
        """
        path, body = _lease_path(namespace, name), lease.write(content, namespace, name)
        method, target = ("PUT", path) if content.version else ("POST", path.rpartition("/")[0])
        patience = urllib3.Timeout(total=timeout)
        return lease.read(json.loads(self._send(method, target, body, JSON, patience)))

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace the finalizers of a ContextPolicy; Conflict when it has changed since `version`."""
        path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{namespace}/contextpolicies/{name}"
        self._send("PATCH", path, {"metadata": {"finalizers": list(finalizers), "resourceVersion": version}}, MERGE)

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """Create an Event."""
        self._send("POST", f"/api/v1/namespaces/{namespace}/events", event, JSON)

    def _list(self, root: str, namespace: str | None, plural: str) -> list[dict[str, Any]]:
        path = f"{root}/{plural}" if namespace is None else f"{root}/namespaces/{namespace}/{plural}"
        found: list[dict[str, Any]] = self.read(path)["items"]
        return found

    def _send(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None,
        content_type: str,
        timeout: urllib3.Timeout = TIMEOUT,
    ) -> bytes:
        target = path if method == "GET" else f"{path}?fieldManager={FIELD_MANAGER}"
        content = None if body is None else json.dumps(body).encode()
        response = self._request(method, target, content, content_type=content_type, timeout=timeout)
        if response.status >= 300:
            raise _refusal(response)
        return response.data

    def _request(self, method: str, target: str, content: bytes | None, **how: Any) -> urllib3.BaseHTTPResponse:
        headers = {"Accept": JSON, "Content-Type": how.pop("content_type", JSON), "User-Agent": FIELD_MANAGER}
        try:
            self._client.update_params_for_auth(headers, [], ["BearerToken"], target, method, content)
            response = self._pool.urlopen(method, self._prefix + target, body=content, headers=headers, **how)
        except config.ConfigException as error:  # the token could not be renewed
            raise ActuationError("NoToken", str(error), retriable=True) from error
        except (urllib3.exceptions.HTTPError, OSError) as error:
            self._count(method, "none")
            path = target.partition("?")[0]
            raise ActuationError("Unreachable", f"{method} {path}: {error}", retriable=True, in_doubt=True) from error
        self._count(method, str(response.status))
        return response

    def _count(self, method: str, code: str) -> None:
        if self._on_answer is not None:
            self._on_answer(method, code)


def _lease_path(namespace: str, name: str) -> str:
    return f"/apis/coordination.k8s.io/v1/namespaces/{namespace}/leases/{name}"


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
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        message = f"the answer is no pod: {answer[:200].decode(errors='replace')}"
        raise ActuationError("Unreadable", message, retriable=True, in_doubt=True) from error


def _refusal(response: urllib3.BaseHTTPResponse) -> ActuationError:
    status, answer = response.status, response.data
    reason, retriable = _REASONS.get(status, ("ServerError" if status >= 500 else "Refused", status >= 500))
    try:
        message = json.loads(answer).get("message", "")
    except (ValueError, AttributeError, RecursionError):
        message = answer[:200].decode(errors="replace")
    text = f"{message or 'no message'} (HTTP {status})"
    pause = response.headers.get("Retry-After", "")  # seconds: the API server writes no dates
    return ActuationError(
        reason,
        text,
        retriable=retriable,
        retry_after=float(pause) if pause.isdecimal() else 0.0,
        in_doubt=status >= 500,  # a gateway may have timed out on what the API server then did
    )
