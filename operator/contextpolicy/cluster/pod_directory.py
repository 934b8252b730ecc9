"""All pods that the watch has shown, by namespace: a policy looks at its own, however many the cluster has."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from contextpolicy.cluster.pods import PodView

if TYPE_CHECKING:
    from collections.abc import Collection


class PodDirectory:
    """The newest view of each pod. Of a namespace without pods nothing is left, once nobody looks at it either."""

    def __init__(self) -> None:
        self._homes: dict[str, _Pods] = {}
        """The pods of each pod's namespace, by its UID."""
        self._namespaces: WeakValueDictionary[str, _Pods] = WeakValueDictionary()

    def put(self, pod: PodView) -> PodView | None:
        """Keep the pod's newest view; returns the one before, None if the pod is new."""
        pods = self._homes[pod.uid] = self._in(pod.namespace)
        before = pods.get(pod.uid)
        pods[pod.uid] = pod
        return before

    def pop(self, uid: str) -> PodView | None:
        """Remove a pod and return it, None if it is unknown."""
        return self._homes.pop(uid).pop(uid) if uid in self._homes else None

    def of(self, namespace: str) -> Collection[PodView]:
        """The pods of a namespace, as a live view."""
        return self._in(namespace).values()

    def _in(self, namespace: str) -> _Pods:
        return self._namespaces.setdefault(namespace, _Pods())


class _Pods(dict[str, PodView]):
    """By UID. A plain dict can't be held weakly."""
