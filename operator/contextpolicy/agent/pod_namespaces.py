"""Which namespace a pod is of, as the node itself tells it: without any right in the API, and whatever a plan says."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class PodNamespaces:
    """Reads the names of the kubelet's log directories, `<namespace>_<pod>_<uid>`: neither part holds an underscore.

    The kubelet makes the directory before the pod's first container, and a pod never changes its namespace: the
    directory is listed again only for a pod that was not there before.
    """

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._by_uid: dict[str, str] = {}

    def of(self, uid: str) -> str | None:
        """None: the node has no such pod."""
        if uid not in self._by_uid:
            self._by_uid = self._list()
        return self._by_uid.get(uid)

    def _list(self) -> dict[str, str]:
        try:
            names = [directory.name.split("_") for directory in self._logs.iterdir()]
        except OSError:
            return {}
        return {parts[2]: parts[0] for parts in names if len(parts) == 3}
