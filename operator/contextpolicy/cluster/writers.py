"""Who last changed a container's CPU, as the API server records in `metadata.managedFields`. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

FIELD_MANAGER = "contextpolicy"
"""The name under which the API server records our writes."""
RESTORE_MANAGER = "contextpolicy-restore"
"""The name for those that put back what was there before: what they wrote is no longer anyone's request."""
OURS = (FIELD_MANAGER, RESTORE_MANAGER)


@dataclass(frozen=True, slots=True)
class Writers:
    """The managers that own a container's CPU request and limit; empty where none is recorded."""

    request: str = ""
    limit: str = ""


NOBODY = Writers()


def writers(metadata: Mapping[str, Any], list_field: str, container: str) -> Writers:
    """The owners of a container's CPU; of several that share ownership, the one that wrote last."""
    entries = sorted(metadata.get("managedFields") or [], key=lambda entry: str(entry.get("time", "")), reverse=True)
    path = ("f:spec", f"f:{list_field}", f'k:{{"name":"{container}"}}', "f:resources")
    found = [(str(entry.get("manager", "")), _inside(entry.get("fieldsV1"), path)) for entry in entries]
    owners = {
        kind: next((manager for manager, fields in found if "f:cpu" in _inside(fields, (kind,))), "")
        for kind in ("f:requests", "f:limits")
    }
    return Writers(owners["f:requests"], owners["f:limits"])


def _inside(fields: object, path: tuple[str, ...]) -> Mapping[str, Any]:
    for step in path:
        fields = fields.get(step) if isinstance(fields, dict) else None
    return fields if isinstance(fields, dict) else {}
