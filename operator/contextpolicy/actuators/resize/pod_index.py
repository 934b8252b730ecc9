"""All pods that the watch has shown, by UID and by the names that planning uses for containers. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.tracked_pod import TrackedPod

if TYPE_CHECKING:
    from collections.abc import Iterable

    from contextpolicy.cluster.pods import ContainerView, PodView


class PodIndex:
    """Looks containers up in constant time, however many other pods the cluster has."""

    def __init__(self) -> None:
        self._pods: dict[str, TrackedPod] = {}
        self._uids: dict[str, str] = {}

    def get(self, view: PodView) -> TrackedPod:
        """The tracked pod of a view; starts tracking it if it is new."""
        pod = self._pods.get(view.uid)
        if pod is None:
            pod = self._pods[view.uid] = TrackedPod(PodState(view))
            self._uids[_key(view)] = view.uid
        return pod

    def pop(self, uid: str) -> TrackedPod | None:
        """Stop tracking a pod and return it; None when it was not tracked."""
        pod = self._pods.pop(uid, None)
        # The next pod of a StatefulSet has the same name, and may be tracked before this one is gone.
        if pod is not None and self._uids.get(_key(pod.view)) == uid:
            del self._uids[_key(pod.view)]
        return pod

    def renew(self, namespace: str) -> None:
        """Forget all that happened to the pods of a namespace; answers still in flight are then ignored."""
        for uid, pod in self._pods.items():
            if pod.view.namespace == namespace:
                self._pods[uid] = TrackedPod(PodState(pod.view))

    def knows(self, uid: str) -> bool:
        """Whether a pod is tracked."""
        return uid in self._pods

    def belongs_to(self, uid: str, namespace: str) -> bool:
        """Whether a pod is tracked and lives in this namespace."""
        return uid in self._pods and self._pods[uid].view.namespace == namespace

    def holds(self, pod: TrackedPod) -> bool:
        """Whether this very pod is tracked: the answer to a patch may come after its pod is gone."""
        return self._pods.get(pod.view.uid) is pod

    def known(self, uids: Iterable[str]) -> list[TrackedPod]:
        """Those of the pods that are tracked, ordered by UID."""
        return [self._pods[uid] for uid in sorted(uids) if uid in self._pods]

    def find(self, identity: str) -> tuple[TrackedPod | None, ContainerView | None]:
        """A container by its identity `namespace/pod/container`, with its pod; None for what is unknown."""
        key, _, name = identity.rpartition("/")
        pod = self._pods.get(self._uids.get(key, ""))
        return pod, pod.view.by_name.get(name) if pod else None


def _key(view: PodView) -> str:
    return f"{view.namespace}/{view.name}"
