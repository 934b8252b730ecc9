"""The namespace of a pod, read from the node itself: needs no access to the API, and does not trust the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class PodNamespaces:
    """Reads the names of the kubelet's log directories, `<namespace>_<pod>_<uid>`; no part contains an underscore.

    The kubelet creates the directory before the pod's first container, and a pod never changes its namespace: so
    listing them again is only needed for an unknown pod.
    """

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._by_uid: dict[str, str] = {}

    def of(self, uid: str) -> str | None:
        """The namespace of the pod with this UID; None when the node has no such pod."""
        if uid not in self._by_uid:
            self._by_uid = self._list()
        return self._by_uid.get(uid)

    def _list(self) -> dict[str, str]:
        try:
            names = [directory.name.split("_") for directory in self._logs.iterdir()]
        except OSError:
            return {}
        return {parts[2]: parts[0] for parts in names if len(parts) == 3}
