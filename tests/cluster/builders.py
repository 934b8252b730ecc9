"""Pods as the API server shows them, so that a test names only what it is about."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

NODE = "robot-1"

Resources = dict[str, dict[str, str]]


def cpu(request: str | None, limit: str | None, memory: tuple[str, str] | None = ("64Mi", "128Mi")) -> Resources:
    """A container's resources; unequal memory keeps its pod Burstable whatever its CPU is."""
    wanted = {"requests": {"cpu": request}, "limits": {"cpu": limit}}
    found = {kind: {k: v for k, v in values.items() if v is not None} for kind, values in wanted.items()}
    if memory is not None:
        found["requests"]["memory"], found["limits"]["memory"] = memory
    return {kind: values for kind, values in found.items() if values}


def a_pod(  # noqa: PLR0913 - each is one thing that a test is about
    name: str = "slam",
    containers: dict[str, Resources] | None = None,
    *,
    sidecars: dict[str, Resources] | None = None,
    qos: str = "Burstable",
    annotations: dict[str, str] | None = None,
    conditions: list[dict[str, Any]] | None = None,
    **metadata: Any,
) -> dict[str, Any]:
    """A running pod whose kubelet has done all that its spec says."""
    containers = {name: cpu("100m", "500m")} if containers is None else containers
    sidecars = sidecars or {}
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {
            "name": name,
            "namespace": "lab",
            "uid": f"uid-{name}",
            "labels": {"app": name},
            "generation": 1,
            "resourceVersion": "100",
            **({"annotations": annotations} if annotations else {}),
            **metadata,
        },
        "spec": {
            "nodeName": NODE,
            "containers": [_spec(one, resources) for one, resources in containers.items()],
            "initContainers": [
                _spec("wait-for-camera", cpu("10m", "20m")),
                *({**_spec(one, resources), "restartPolicy": "Always"} for one, resources in sidecars.items()),
            ],
        },
        "status": {
            "phase": "Running",
            "qosClass": qos,
            "observedGeneration": 1,
            "conditions": [{"type": "Ready", "status": "True"}, *(conditions or [])],
            "containerStatuses": [_status(one, resources) for one, resources in containers.items()],
            "initContainerStatuses": [
                {"name": "wait-for-camera", "containerID": "containerd://done", "state": {"terminated": {}}},
                *(_status(one, resources) for one, resources in sidecars.items()),
            ],
        },
    }


def _spec(name: str, resources: Resources) -> dict[str, Any]:
    return {"name": name, "image": f"{name}:dev", "resources": deepcopy(resources), "resizePolicy": []}


def granted(request: str, pod: dict[str, Any]) -> dict[str, Any]:
    """The pod, whose containers' kubelet has granted them this request, whatever their spec says."""
    for status in pod["status"]["containerStatuses"]:
        status["allocatedResources"] = {"cpu": request}
    return pod


def _status(name: str, resources: Resources) -> dict[str, Any]:
    return {
        "name": name,
        "containerID": f"containerd://{name}",
        "ready": True,
        "restartCount": 0,
        "state": {"running": {"startedAt": "2026-01-01T00:00:00Z"}},
        "allocatedResources": deepcopy(resources.get("requests", {})),
        "resources": deepcopy(resources),
    }
