"""All pods that the watch has shown, by namespace: a policy looks at its own, however many the cluster has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    from contextpolicy.cluster.pods import PodView


class PodDirectory:
    """The newest view of each pod."""

    def __init__(self) -> None:
        self._namespaces: dict[str, str] = {}
        self._pods: dict[str, dict[str, PodView]] = {}

    def put(self, pod: PodView) -> PodView | None:
        """Keep the pod's newest view; returns the one before, None if the pod is new."""
        before = self.get(pod.uid)
        self._namespaces[pod.uid] = pod.namespace
        self._pods.setdefault(pod.namespace, {})[pod.uid] = pod
        return before

    def get(self, uid: str) -> PodView | None:
        """The pod, None if it is unknown."""
        namespace = self._namespaces.get(uid)
        return None if namespace is None else self._pods[namespace][uid]

    def pop(self, uid: str) -> PodView | None:
        """Remove a pod and return it, None if it is unknown."""
        namespace = self._namespaces.pop(uid, None)
        return None if namespace is None else self._pods[namespace].pop(uid)

    def of(self, namespace: str) -> Collection[PodView]:
        """The pods of a namespace, as a live view."""
        return self._pods.setdefault(namespace, {}).values()
