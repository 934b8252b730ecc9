"""Which controller a pod belongs to. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class Owner(NamedTuple):
    """A pod's controller."""

    api_version: str
    kind: str
    name: str
    uid: str


def owner_of(metadata: Mapping[str, Any]) -> Owner | None:
    """The controller that a pod names, if it has one."""
    for one in metadata.get("ownerReferences") or []:
        if one.get("controller"):
            return Owner(*(str(one.get(key, "")) for key in ("apiVersion", "kind", "name", "uid")))
    return None
