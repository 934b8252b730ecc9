"""The API server, spoken to directly: starting kubectl costs seconds in the machine."""

from __future__ import annotations

import json
import ssl
from functools import cache
from pathlib import Path
from typing import Any

import urllib3

from tests.node.layout import KUBECONFIG

TIMEOUT = 120.0
SERVER_SIDE = {"Content-Type": "application/apply-patch+yaml"}
STRATEGIC = {"Content-Type": "application/strategic-merge-patch+json"}


class ApiError(AssertionError):
    """The API server refused; the message is its own."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code


def get(kind: str, name: str, namespace: str) -> dict[str, Any]:
    """One object; `kind` is the plural, such as pods or apps/v1/deployments."""
    return _call("GET", f"{_collection(kind, namespace)}/{name}")


def items(kind: str, namespace: str, **labels: str) -> list[dict[str, Any]]:
    """All objects of a namespace that have these labels."""
    chosen = ",".join(f"{name}={value}" for name, value in labels.items())
    found: list[dict[str, Any]] = _call("GET", f"{_collection(kind, namespace)}?labelSelector={chosen}")["items"]
    return found


def apply(*objects: dict[str, Any]) -> None:
    """As `kubectl apply --server-side --force-conflicts`."""
    for one in objects:
        path = _path(one["apiVersion"], one["kind"], one["metadata"].get("namespace", ""))
        name = one["metadata"]["name"]
        _call("PATCH", f"{path}/{name}?fieldManager=tests&force=true", one, SERVER_SIDE)


def resize(pod: str, namespace: str, **resources: Any) -> dict[str, Any]:
    """Resize the container that has the pod's name."""
    body = {"spec": {"containers": [{"name": pod, "resources": resources}]}}
    return _call("PATCH", f"{_collection('pods', namespace)}/{pod}/resize", body, STRATEGIC)


def try_resize(pod: str, namespace: str) -> str:
    """What the API server says against a resize that it is only asked about; empty when nothing."""
    body = {"spec": {"containers": [{"name": pod, "resources": {"limits": {"cpu": "123m"}}}]}}
    try:
        _call("PATCH", f"{_collection('pods', namespace)}/{pod}/resize?dryRun=All", body, STRATEGIC)
    except ApiError as error:
        return str(error)
    return ""


def delete(kind: str, name: str, namespace: str) -> None:
    """Delete; nothing to do when it is not there. Finalizers may take their time after that."""
    try:
        _call("DELETE", f"{_collection(kind, namespace)}/{name}")
    except ApiError as error:
        if error.code != 404:
            raise


def exists(kind: str, name: str, namespace: str) -> bool:
    """Whether there is such an object."""
    try:
        get(kind, name, namespace)
    except ApiError as error:
        if error.code == 404:
            return False
        raise
    return True


def _collection(kind: str, namespace: str) -> str:
    version, _, plural = kind.rpartition("/")
    inside = f"/namespaces/{namespace}" if namespace else ""
    return f"{_root(version or 'v1')}{inside}/{plural}"


def _root(version: str) -> str:
    return f"/apis/{version}" if "/" in version else f"/api/{version}"


def _path(version: str, kind: str, namespace: str) -> str:
    resource = next(one for one in _resources(version) if one["kind"] == kind and "/" not in one["name"])
    inside = f"/namespaces/{namespace or 'default'}" if resource["namespaced"] else ""
    return f"{_root(version)}{inside}/{resource['name']}"


@cache
def _resources(version: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = _call("GET", _root(version))["resources"]
    return found


def _call(method: str, path: str, body: object = None, headers: dict[str, str] | None = None) -> dict[str, Any]:
    server, pool = _connection()
    content = None if body is None else json.dumps(body).encode()
    answer = pool.request(method, server + path, body=content, headers=headers, timeout=TIMEOUT, retries=3)
    said: dict[str, Any] = json.loads(answer.data)
    if answer.status >= 400:
        raise ApiError(answer.status, said.get("message", str(said)))
    return said


@cache
def _connection() -> tuple[str, urllib3.PoolManager]:
    config = json.loads(Path(KUBECONFIG).read_text())
    [cluster], [user] = config["clusters"], config["users"]
    context = ssl.create_default_context(cafile=cluster["cluster"]["certificate-authority"])
    context.load_cert_chain(user["user"]["client-certificate"], user["user"]["client-key"])
    return cluster["cluster"]["server"], urllib3.PoolManager(ssl_context=context)
