"""Limits that another writer keeps setting, and that the operator and its agents leave in place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reactivex import Subject

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import PodView


class Contests:
    """By pod UID and container; everything on the loop's thread."""

    def __init__(self) -> None:
        self.changes: Subject[str] = Subject()
        """The namespace of each pod where something else is left in place than before."""
        self._left: dict[str, dict[str, int]] = {}
        self._namespaces: dict[str, str] = {}

    def left(self, uid: str, name: str) -> int | None:
        """The limit that is left in place, in thousandths of a core; None while the plan is enforced."""
        return self._left.get(uid, {}).get(name)

    def note(self, pod: PodView, name: str, limit: int | None) -> None:
        """Remember which limit of the container is left in place; None if none is."""
        if limit == self.left(pod.uid, name):
            return
        limits = self._left.setdefault(pod.uid, {})
        if limit is None:
            del limits[name]
        else:
            limits[name] = limit
        self._namespaces[pod.uid] = pod.namespace
        if not limits:
            self.forget(pod.uid)
        self.changes.on_next(pod.namespace)

    def forget(self, uid: str) -> None:
        """The pod is gone."""
        self._left.pop(uid, None)
        self._namespaces.pop(uid, None)

    def abandon(self, namespace: str) -> None:
        """Another operator serves this namespace now."""
        for uid in [uid for uid, own in self._namespaces.items() if own == namespace]:
            self.forget(uid)
