"""What one replica watches: pods and nodes, and, where all namespaces are served, which of them have policies."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.watching import ObjectWatch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from contextpolicy.app.wiring import Operator
    from contextpolicy.cluster.watching import ListWatch

log = logging.getLogger(__name__)

POLICIES = "/apis/contextpolicy.dev/v1alpha1/contextpolicies"
NOT_SERVED = (
    "namespace %s is not served: its pods may not be listed. Upgrade the release if its Role is missing. If the "
    "namespace is being deleted, the Role is gone already, and policies that are left there hold it up: let them go "
    "with `contextpolicy restore --namespace %s --remove-finalizers`"
)


class Watches:
    """Hands pods and nodes to the operator; without `namespaces`, those of all.

    `on_change` is called, on any thread, when a list was read or refused and when policies came or went.
    """

    def __init__(
        self, api: ListWatch, namespaces: Iterable[str], operator: Operator, on_change: Callable[[], None]
    ) -> None:
        pods, nodes, self._policies = _Pods(operator, on_change), _Nodes(operator, on_change), _Policies(on_change)
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
    def __init__(self, operator: Operator, on_change: Callable[[], None]) -> None:
        self._operator, self._on_change = operator, on_change

    def on_object(self, item: Mapping[str, Any]) -> None:
        self._operator.pod_changed(item)

    def on_gone(self, uid: str) -> None:
        self._operator.pod_gone(uid)

    def on_listing(self) -> None:
        self._on_change()


class _Nodes:
    def __init__(self, operator: Operator, on_change: Callable[[], None]) -> None:
        self._operator, self._on_change = operator, on_change

    def on_object(self, item: Mapping[str, Any]) -> None:
        self._operator.node_changed(item)

    def on_gone(self, uid: str) -> None:
        self._operator.node_gone(uid)

    def on_listing(self) -> None:
        self._on_change()


class _Policies:
    """The namespace of each policy by UID."""

    def __init__(self, on_change: Callable[[], None]) -> None:
        self.namespaces: dict[str, str] = {}
        self._on_change = on_change

    def on_object(self, item: Mapping[str, Any]) -> None:
        self.namespaces[item["metadata"]["uid"]] = item["metadata"]["namespace"]
        self._on_change()

    def on_gone(self, uid: str) -> None:
        self.namespaces.pop(uid, None)
        self._on_change()

    def on_listing(self) -> None:
        self._on_change()


def pods_of(namespace: str) -> str:
    """The list of a namespace's pods."""
    return f"/api/v1/namespaces/{namespace}/pods"
