"""All pods that the watch has shown, by namespace: a policy looks at its own, however many the cluster has."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from contextpolicy.cluster.pods import PodView
from contextpolicy.cluster.room import requested

if TYPE_CHECKING:
    from collections.abc import Collection


class PodDirectory:
    """The newest view of each pod. A namespace is dropped once it has neither pods nor watchers."""

    def __init__(self) -> None:
        self._homes: dict[str, _Pods] = {}
        """The pods of each pod's namespace, by its UID."""
        self._namespaces: WeakValueDictionary[str, _Pods] = WeakValueDictionary()
        self._requests: Counter[tuple[str, str]] = Counter()
        """The CPU that pods request, by namespace and node."""

    def put(self, pod: PodView) -> PodView | None:
        """Keep the pod's newest view; returns the one before, None if the pod is new."""
        pods = self._homes[pod.uid] = self._in(pod.namespace)
        before = pods.get(pod.uid)
        pods[pod.uid] = pod
        self._count(before, -1)
        self._count(pod, 1)
        return before

    def pop(self, uid: str) -> PodView | None:
        """Remove a pod and return it, None if it is unknown."""
        pod = self._homes.pop(uid).pop(uid) if uid in self._homes else None
        self._count(pod, -1)
        return pod

    def of(self, namespace: str) -> Collection[PodView]:
        """The pods of a namespace, as a live view."""
        return self._in(namespace).values()

    def requested(self, but: Collection[str]) -> dict[str, int]:
        """The CPU that pods request, by node, in thousandths of a core; `but` are namespaces that don't count."""
        found: Counter[str] = Counter()
        for (namespace, node), amount in self._requests.items():
            if namespace not in but:
                found[node] += amount
        return dict(found)

    def _count(self, pod: PodView | None, sign: int) -> None:
        amount = requested(pod) if pod is not None else 0
        if pod is not None and amount:
            place = pod.namespace, pod.node
            self._requests[place] += sign * amount
            if not self._requests[place]:
                del self._requests[place]

    def _in(self, namespace: str) -> _Pods:
        return self._namespaces.setdefault(namespace, _Pods())


class _Pods(dict[str, PodView]):
    """By UID. A plain dict can't be held weakly."""
