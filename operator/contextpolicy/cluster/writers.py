"""Who last changed a container's CPU, as the API server records in `metadata.managedFields`. Pure."""

from __future__ import annotations

from collections import defaultdict
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


def writers(metadata: Mapping[str, Any], list_field: str) -> dict[str, Writers]:
    """By container, the owners of its CPU, where any is recorded; of several that share it, the one that wrote last.

    Each entry is read once: anyone who may change a pod can have thousands of managers recorded in it.
    """
    entries = sorted(metadata.get("managedFields") or [], key=lambda entry: str(entry.get("time", "")), reverse=True)
    owners: defaultdict[str, dict[str, str]] = defaultdict(dict)
    for entry in entries:
        for key, fields in _inside(entry.get("fieldsV1"), ("f:spec", f"f:{list_field}")).items():
            for kind, field in (("request", "f:requests"), ("limit", "f:limits")):
                if "f:cpu" in _inside(fields, ("f:resources", field)):
                    owners[key].setdefault(kind, str(entry.get("manager", "")))
    return {key.removeprefix('k:{"name":"').removesuffix('"}'): Writers(**kinds) for key, kinds in owners.items()}


def _inside(fields: object, path: tuple[str, ...]) -> Mapping[str, Any]:
    for step in path:
        fields = fields.get(step) if isinstance(fields, dict) else None
    return fields if isinstance(fields, dict) else {}
