"""The CPU of containers by their pod's owner: the pod template of a built-in controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import quote

from contextpolicy.cluster.pod_parsing import cpu_of
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.owner_references import Owner
    from contextpolicy.cluster.pods import PodView

PATHS = {
    ("apps/v1", "ReplicaSet"): "/apis/apps/v1/namespaces/{}/replicasets/{}",
    ("apps/v1", "StatefulSet"): "/apis/apps/v1/namespaces/{}/statefulsets/{}",
    ("apps/v1", "DaemonSet"): "/apis/apps/v1/namespaces/{}/daemonsets/{}",
    ("batch/v1", "Job"): "/apis/batch/v1/namespaces/{}/jobs/{}",
}
"""Where owners are that have a pod template, by API version and kind."""


class OwnerApi(Protocol):
    """The call to the API server that templates need."""

    def read(self, path: str) -> dict[str, Any]:
        """GET an object."""


class Templates:
    """Reads each owner once; everything that can't be read is unknown."""

    def __init__(self, api: OwnerApi) -> None:
        self._api = api
        self._read: dict[tuple[str, Owner], dict[str, Any] | None] = {}

    def cpu(self, pod: PodView) -> Mapping[str, Cpu]:
        """By container, what the template says that this pod was made of; empty where that is unknown."""
        owner = pod.owner
        if owner is None or (owner.api_version, owner.kind) not in PATHS:
            return {}
        key = pod.namespace, owner
        if key not in self._read:
            self._read[key] = self._get(pod.namespace, owner)
        found = self._read[key]
        try:
            return _containers(found) if found is not None and _made(found, pod) else {}
        except (ValueError, TypeError, KeyError, AttributeError):
            return {}

    def _get(self, namespace: str, owner: Owner) -> dict[str, Any] | None:
        try:
            found = self._api.read(PATHS[owner.api_version, owner.kind].format(namespace, quote(owner.name, safe="")))
        except ActuationError:
            return None
        return found if (found.get("metadata") or {}).get("uid") == owner.uid else None


def _made(owner: Mapping[str, Any], pod: PodView) -> bool:
    """Whether the template is still the one that the pod was made of: those of sets that roll out change."""
    made_of = pod.labels.get("pod-template-generation") or pod.labels.get("controller-revision-hash")
    annotations = owner["metadata"].get("annotations") or {}
    now = annotations.get("deprecated.daemonset.template.generation") or (owner.get("status") or {}).get(
        "updateRevision"
    )
    return made_of is None or now is None or made_of == now


def _containers(owner: Mapping[str, Any]) -> dict[str, Cpu]:
    spec = owner["spec"]["template"]["spec"]
    every = [*(spec.get("containers") or []), *(spec.get("initContainers") or [])]
    return {one["name"]: _with_defaults(cpu_of(one.get("resources") or {})) for one in every}


def _with_defaults(cpu: Cpu) -> Cpu:
    """As the API server completes a container: a limit alone is also the request."""
    return Cpu(cpu.limit if cpu.request is None else cpu.request, cpu.limit)
