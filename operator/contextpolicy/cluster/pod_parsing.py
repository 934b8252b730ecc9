"""Pod objects of the API, as the operator sees them (see `pods`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.owner_references import owner_of
from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
from contextpolicy.cluster.resource_quantities import in_bytes, millicores
from contextpolicy.cluster.writers import NOBODY, Writers, writers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

MIRROR = "kubernetes.io/config.mirror"
"""Annotation of a static pod's mirror pod in the API; the kubelet refuses to resize it."""

MOST_LABELS = MOST_CONTAINERS = 100
"""A view keeps no more: anyone may create pods with tens of thousands, and views of all pods stay in memory."""


def view(pod: Mapping[str, Any]) -> PodView:
    """The view of a pod object from the API; ValueError when it can't be read, such as for a quantity that is none.

    One with too many labels is seen without them, so no task selects it. One with too many containers is seen without
    them too; what they request is `reserved`.
    """
    try:
        return _view(pod)
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"not a pod: {error!r:.200}") from error


def _view(pod: Mapping[str, Any]) -> PodView:
    metadata, spec, status = pod["metadata"], pod.get("spec") or {}, pod.get("status") or {}
    annotations, labels = metadata.get("annotations") or {}, metadata.get("labels") or {}
    containers = tuple(_containers(metadata, spec, status))
    crowd = containers if len(containers) > MOST_CONTAINERS else ()
    return PodView(
        namespace=metadata["namespace"],
        name=metadata["name"],
        uid=metadata["uid"],
        node=spec.get("nodeName") or "",
        labels=labels if len(labels) <= MOST_LABELS else {},
        qos=status.get("qosClass") or "",
        mirror=MIRROR in annotations,
        containers=() if crowd else containers,
        generation=metadata.get("generation") or 0,
        observed_generation=status.get("observedGeneration"),
        pending=_pending(status),
        resizing=any(condition.get("type") == "PodResizeInProgress" for condition in _true_conditions(status)),
        ended=bool(metadata.get("deletionTimestamp")) or status.get("phase") in ("Succeeded", "Failed"),
        running=any("running" in (entry.get("state") or {}) for entry in _statuses(status)),
        version=version_of(metadata),
        reserved=max(_peak(spec), cpu_of(spec.get("resources") or {}).request or 0, sum(one.kept for one in crowd)),
        overhead=millicores((spec.get("overhead") or {}).get("cpu")) or 0,
        owner=owner_of(metadata),
        pooled=cpu_of(spec.get("resources") or {}) != Cpu(None, None),
        limit=cpu_of(spec.get("resources") or {}).limit,
    )


def _peak(spec: Mapping[str, Any]) -> int:
    """The most that is requested while init containers run: each beside the sidecars that started before it."""
    sidecars = most = 0
    for container in spec.get("initContainers") or []:
        request = cpu_of(container.get("resources") or {}).request or 0
        most = max(most, sidecars + request)
        sidecars += request if container.get("restartPolicy") == "Always" else 0
    return most


def version_of(metadata: Mapping[str, Any]) -> int:
    """The resourceVersion of an object; 0 when it is not a number, which Kubernetes guarantees only since 1.35."""
    version = str(metadata.get("resourceVersion", ""))
    return int(version) if version.isdecimal() else 0


def _containers(
    metadata: Mapping[str, Any], spec: Mapping[str, Any], status: Mapping[str, Any]
) -> Iterator[ContainerView]:
    """The long-running containers: init containers only if they are sidecars (`restartPolicy: Always`)."""
    sidecars = [c for c in spec.get("initContainers") or [] if c.get("restartPolicy") == "Always"]
    by_name = {entry["name"]: entry for entry in _statuses(status)}
    for kind, containers in (("containers", spec.get("containers") or []), ("initContainers", sidecars)):
        by = writers(metadata, kind)
        for container in containers:
            name = container["name"]
            yield _container(container, kind, by_name.get(name, {}), by.get(name, NOBODY))


def _statuses(status: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [*(status.get("containerStatuses") or []), *(status.get("initContainerStatuses") or [])]


def _container(container: Mapping[str, Any], field: str, status: Mapping[str, Any], by: Writers) -> ContainerView:
    resources = container.get("resources") or {}
    requests, limits = resources.get("requests") or {}, resources.get("limits") or {}
    actual = status.get("resources")
    return ContainerView(
        name=container["name"],
        list_field=field,
        spec=cpu_of(resources),
        actual=None if actual is None else cpu_of(actual),
        memory_request=in_bytes(requests.get("memory")),
        memory_limit=in_bytes(limits.get("memory")),
        container_id=status.get("containerID") or "",
        allocated=millicores((status.get("allocatedResources") or {}).get("cpu")),
        writers=by,
        restarts=any(
            policy.get("resourceName") == "cpu" and policy.get("restartPolicy") == "RestartContainer"
            for policy in container.get("resizePolicy") or []
        ),
        probed=bool(container.get("livenessProbe")),
    )


def cpu_of(resources: Mapping[str, Any]) -> Cpu:
    """The CPU of a container's `resources`."""
    return Cpu(
        millicores((resources.get("requests") or {}).get("cpu")), millicores((resources.get("limits") or {}).get("cpu"))
    )


def _pending(status: Mapping[str, Any]) -> str:
    """Why the kubelet has not carried out a resize: `Deferred: ...`, `Infeasible: ...`, `Error: ...`; else empty."""
    for condition in _true_conditions(status):
        waits = condition.get("type") == "PodResizePending"
        failed = condition.get("type") == "PodResizeInProgress" and condition.get("reason") == "Error"
        if waits or failed:
            return f"{condition.get('reason')}: {condition.get('message', '')}"
    return ""


def _true_conditions(status: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    return (condition for condition in status.get("conditions") or [] if condition.get("status") == "True")
