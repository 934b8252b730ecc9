"""Fencing: an operator that lost its Lease stops writing, however late its threads notice."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.cluster.paging import PageReader
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.paging import Page


class Fence(Protocol):
    """Decides in which namespaces this operator may act."""

    def may_act(self, namespace: str) -> bool:
        """Whether we may write in a namespace at this instant."""


class PolicyApi(PageReader, Protocol):
    """The calls to the API server that running policies need."""

    def read(self, path: str) -> dict[str, Any]:
        """GET an object."""

    def config_map(self, namespace: str, name: str) -> dict[str, str]:
        """The data of a ConfigMap."""

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        """GET a pod."""

    def resize(self, namespace: str, pod: str, patch: Mapping[str, Any], manager: str) -> int:
        """PATCH pods/resize as this field manager; the changed pod's resourceVersion."""

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> int:
        """Merge into `status.originals` of a ContextPolicy; its resourceVersion."""

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """Merge into the status of a ContextPolicy."""

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """Create an Event."""


class FencedApi:
    """The API server, with the fence asked before each write: ActuationError `NotLeading` where we may not act."""

    def __init__(self, api: PolicyApi, fence: Fence) -> None:
        self._api, self._fence = api, fence

    def read(self, path: str) -> dict[str, Any]:
        """See `ApiServer.read`."""
        return self._api.read(path)

    def read_page(self, path: str, most: int | None) -> Page | None:
        """See `ApiServer.read_page`."""
        return self._api.read_page(path, most)

    def config_map(self, namespace: str, name: str) -> dict[str, str]:
        """See `ApiServer.config_map`."""
        return self._api.config_map(namespace, name)

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        """See `ApiServer.pod`."""
        return self._api.pod(namespace, name)

    def resize(self, namespace: str, pod: str, patch: Mapping[str, Any], manager: str) -> int:
        """See `ApiServer.resize`."""
        self._check(namespace)
        return self._api.resize(namespace, pod, patch, manager)

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> int:
        """See `ApiServer.write_originals`."""
        self._check(namespace)
        return self._api.write_originals(namespace, policy, changes)

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """See `ApiServer.write_status`."""
        self._check(namespace)
        self._api.write_status(namespace, name, status)

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """See `ApiServer.post_event`."""
        self._check(namespace)
        self._api.post_event(namespace, event)

    def _check(self, namespace: str) -> None:
        if not self._fence.may_act(namespace):
            message = f"namespace {namespace}: this operator holds no valid Lease"
            raise ActuationError("NotLeading", message, retriable=True)
