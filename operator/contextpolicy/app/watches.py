"""What one replica watches: pods and nodes, and, where all namespaces are served, which of them have policies."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.policy.custom_resource import API, PLURAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from contextpolicy.app.wiring import Operator
    from contextpolicy.cluster.watching import ListWatch

log = logging.getLogger(__name__)

POLICIES = f"{API}/{PLURAL}"
NOT_SERVED = (
    "not serving namespace %s: listing its pods is forbidden. If its Role is missing, upgrade the release. If the "
    "namespace is being deleted, its Role is gone already, and policies left there block the deletion: release them "
    "with `contextpolicy restore --namespace %s --remove-finalizers`"
)


class ListsListener(Protocol):
    """What hears of the lists; called on any thread."""

    def on_lists(self) -> None:
        """A list was read or refused, or policies came or went."""


class Watches:
    """Hands pods and nodes to the operator; without `namespaces`, those of all."""

    def __init__(self, api: ListWatch, namespaces: Iterable[str], operator: Operator, listener: ListsListener) -> None:
        pods, nodes, self._policies = _Pods(operator, listener), _Nodes(operator, listener), _Policies(listener)
        self._pods = {namespace: ObjectWatch(api, pods_of(namespace), pods) for namespace in namespaces}
        self._all = [*self._pods.values(), ObjectWatch(api, "/api/v1/nodes", nodes)]
        if not self._pods:
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
        """The lists not read yet. A namespace of several whose pods we may not see keeps us from no other."""
        refused = [watch for watch in self._pods.values() if watch.refused]
        return [str(watch) for watch in self._all if not watch.listed.done() and watch not in refused]

    def served(self) -> set[str]:
        """The namespaces that may be served: those with policies or as configured, where we may list the pods."""
        refused = frozenset(namespace for namespace, watch in self._pods.items() if watch.refused)
        for namespace in sorted(refused - self._refused):
            log.warning(NOT_SERVED, namespace, namespace)
        self._refused = refused
        return (set(self._pods) or set(self._policies.namespaces.values())) - refused


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
    """The namespace of each policy by UID."""

    def __init__(self, listener: ListsListener) -> None:
        self.namespaces: dict[str, str] = {}
        self._listener = listener

    def on_object(self, item: Mapping[str, Any]) -> None:
        self.namespaces[item["metadata"]["uid"]] = item["metadata"]["namespace"]
        self._listener.on_lists()

    def on_gone(self, uid: str) -> None:
        self.namespaces.pop(uid, None)
        self._listener.on_lists()

    def on_listing(self) -> None:
        self._listener.on_lists()


def pods_of(namespace: str) -> str:
    """The list of a namespace's pods."""
    return f"/api/v1/namespaces/{namespace}/pods"
