"""What one replica watches: pods and nodes, and which policies there are: kopf does not report all that are gone."""

from __future__ import annotations

import logging
from math import inf
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.policy.custom_resource import API, PLURAL

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from contextpolicy.app.wiring import Operator
    from contextpolicy.cluster.watching import ListWatch

log = logging.getLogger(__name__)

POLICIES = f"{API}/{PLURAL}"
LINGER = 60.0
"""Seconds for which a namespace without policies is kept: one policy that is made and deleted over and over must not
stop and start kopf each time, for the namespaces that it serves besides. The Lease is kept for as long."""
NOT_SERVED = (
    "not serving namespace %s: listing its pods is forbidden. If its Role is missing, upgrade the release. If the "
    "namespace is being deleted, its Role is gone already, and policies left there block the deletion: release them "
    "with `contextpolicy restore --namespace %s --remove-finalizers`"
)


class ListsListener(Protocol):
    """Receives changes of the lists; called on any thread."""

    def on_lists(self) -> None:
        """A list was read or refused, or policies came or went."""


class Watches:
    """Hands pods and nodes to the operator; without `namespaces`, those of all."""

    def __init__(
        self,
        api: ListWatch,
        namespaces: Iterable[str],
        operator: Operator,
        listener: ListsListener,
        clock: Callable[[], float],
    ) -> None:
        pods, nodes = _Pods(operator, listener), _Nodes(operator, listener)
        self._policies = _Policies(operator, listener, clock)
        self._pods = {namespace: ObjectWatch(api, pods_of(namespace), pods) for namespace in namespaces}
        policies = [ObjectWatch(api, policies_of(namespace), self._policies) for namespace in self._pods]
        self._named = [*self._pods.values(), *policies]
        self._all = [*self._named, ObjectWatch(api, "/api/v1/nodes", nodes)]
        if not self._named:
            self._all += [ObjectWatch(api, "/api/v1/pods", pods), ObjectWatch(api, POLICIES, self._policies)]
        self._refused: frozenset[str] = frozenset()

    def start(self) -> None:
        """Start to follow all lists."""
        for watch in self._all:
            watch.start()

    def stop(self) -> None:
        """End them."""
        for watch in self._all:
            watch.stop()

    def check(self) -> Iterable[str]:
        """Which of them have ended."""
        for watch in self._all:
            try:
                watch.check()
            except RuntimeError as error:
                yield str(error)

    def unlisted(self) -> list[str]:
        """The lists not read yet. A namespace of several where we may not see them keeps us from no other."""
        refused = [watch for watch in self._named if watch.refused]
        return [str(watch) for watch in self._all if not watch.listed.done() and watch not in refused]

    def served(self, before: Collection[str]) -> set[str]:
        """The namespaces that may be served: those with policies or as configured, where we may list the pods.

        One that was served `before` and lost its last policy just now is kept for a while.
        """
        refused = frozenset(namespace for namespace, watch in self._pods.items() if watch.refused)
        for namespace in sorted(refused - self._refused):
            log.warning(NOT_SERVED, namespace, namespace)
        self._refused = refused
        return (set(self._pods) or self._policies.served(before)) - refused

    def next_change(self) -> float | None:
        """Seconds until a kept namespace is dropped; None without one."""
        return self._policies.next_change()


class _Pods:
    def __init__(self, operator: Operator, listener: ListsListener) -> None:
        self._operator, self._listener = operator, listener

    def on_object(self, item: Mapping[str, Any]) -> None:
        self._operator.pod_changed(item)

    def on_gone(self, uid: str) -> None:
        self._operator.pod_gone(uid)

    def on_listing(self) -> None:
        self._listener.on_lists()


class _Nodes:
    def __init__(self, operator: Operator, listener: ListsListener) -> None:
        self._operator, self._listener = operator, listener

    def on_object(self, item: Mapping[str, Any]) -> None:
        self._operator.node_changed(item)

    def on_gone(self, uid: str) -> None:
        self._operator.node_gone(uid)

    def on_listing(self) -> None:
        self._listener.on_lists()


class _Policies:
    """The namespace of each policy by UID, and when others lost their last one; changed on the watch's thread."""

    def __init__(self, operator: Operator, listener: ListsListener, clock: Callable[[], float]) -> None:
        self._namespaces: dict[str, str] = {}
        self._left: dict[str, float] = {}
        self._operator, self._listener, self._clock = operator, listener, clock
        self._lock = Lock()

    def on_object(self, item: Mapping[str, Any]) -> None:
        namespace = item["metadata"]["namespace"]
        with self._lock:
            self._namespaces[item["metadata"]["uid"]] = namespace
            self._left.pop(namespace, None)
        self._listener.on_lists()

    def on_gone(self, uid: str) -> None:
        with self._lock:
            namespace = self._namespaces.pop(uid, None)
            if namespace is not None and namespace not in self._namespaces.values():
                self._left[namespace] = self._clock()
        self._operator.policy_gone(uid)
        self._listener.on_lists()

    def served(self, before: Collection[str]) -> set[str]:
        with self._lock:
            now = self._clock()
            self._left = {name: at for name, at in self._left.items() if now < at + LINGER and name in before}
            return {*self._namespaces.values(), *self._left}

    def next_change(self) -> float | None:
        with self._lock:
            now = self._clock()
            due = min(self._left.values(), default=inf) + LINGER
            if due <= now:  # said once: who asks may not be serving yet
                self._left = {name: at for name, at in self._left.items() if now < at + LINGER}
            return None if due == inf else max(0.0, due - now)

    def on_listing(self) -> None:
        self._listener.on_lists()


def pods_of(namespace: str) -> str:
    """The list of a namespace's pods."""
    return f"/api/v1/namespaces/{namespace}/pods"


def policies_of(namespace: str) -> str:
    """The list of a namespace's policies."""
    return f"{API}/namespaces/{namespace}/{PLURAL}"
