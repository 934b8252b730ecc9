"""All pods that the watch has shown, by namespace: a policy looks at its own, however many the cluster has."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from contextpolicy.cluster.pods import PodView
from contextpolicy.cluster.room import requested
from contextpolicy.cluster.weight_bounds import granted

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
        self._grants: Counter[tuple[str, str]] = Counter()
        """What of that kubelets have granted."""

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
        return _by_node(self._requests, but)

    def granted(self, but: Collection[str]) -> dict[str, int]:
        """What of that kubelets have granted: what the pods weigh."""
        return _by_node(self._grants, but)

    def _count(self, pod: PodView | None, sign: int) -> None:
        if pod is not None:
            place = pod.namespace, pod.node
            _add(self._requests, place, sign * requested(pod))
            _add(self._grants, place, sign * granted(pod))

    def _in(self, namespace: str) -> _Pods:
        return self._namespaces.setdefault(namespace, _Pods())


class _Pods(dict[str, PodView]):
    """By UID. A plain dict can't be held weakly."""


def _add(amounts: Counter[tuple[str, str]], place: tuple[str, str], amount: int) -> None:
    amounts[place] += amount
    if not amounts[place]:
        del amounts[place]


def _by_node(amounts: Counter[tuple[str, str]], but: Collection[str]) -> dict[str, int]:
    found: Counter[str] = Counter()
    for (namespace, node), amount in amounts.items():
        if namespace not in but:
            found[node] += amount
    return dict(found)
