"""Definitions of ROS 2 messages as files: where they come from, and which stream uses which."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, TypeGuard

from contextpolicy.errors import DefinitionError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from contextpolicy.policy.spec import Policy

Definitions: TypeAlias = tuple[tuple[str, str], ...]
"""Files as (name, text). A `.msg` is named after its type, `my_msgs.msg.Mood.msg`; an `.idl` names its types itself."""

SUFFIXES = (".msg", ".idl")


def of_config_map(data: Mapping[str, str]) -> Definitions:
    """The definitions among a ConfigMap's keys."""
    return tuple(sorted((name, text) for name, text in data.items() if name.endswith(SUFFIXES)))


def config_maps(body: object) -> dict[tuple[str, str], Definitions]:
    """The definitions of a ConfigMap in YAML, or of all in a List, by namespace and name."""
    if not isinstance(body, dict):
        return {}
    found: dict[tuple[str, str], Definitions] = {}
    for item in body.get("items") or [] if body.get("kind") == "List" else [body]:
        metadata, data = (item.get("metadata"), item.get("data")) if _is_config_map(item) else (None, None)
        if isinstance(metadata, dict) and isinstance(data, dict):
            texts = {str(name): str(text) for name, text in data.items()}
            found[str(metadata.get("namespace", "default")), str(metadata.get("name"))] = of_config_map(texts)
    return found


def of_folder(folder: Path) -> Definitions:
    """The definitions in and below a folder, such as a package's `share`; DefinitionError when there are none."""
    files = sorted(path for path in folder.resolve().rglob("*") if path.suffix in SUFFIXES and path.is_file())
    if not files:
        raise DefinitionError(f"{folder}: holds no .msg and no .idl files")
    try:
        return tuple((path.as_posix(), path.read_text(encoding="utf-8")) for path in files)
    except (OSError, UnicodeDecodeError) as error:
        raise DefinitionError(f"{folder}: can't be read: {error}") from error


def _is_config_map(body: object) -> TypeGuard[dict[str, object]]:
    return isinstance(body, dict) and body.get("kind") == "ConfigMap"


def with_definitions(policy: Policy, read: Callable[[str], Definitions | None]) -> Policy:
    """The policy with the definitions that its streams name; `read` returns a ConfigMap's, None if it is not there."""
    known = {name: read(name) for name in {stream.types for stream in policy.streams if stream.types}}
    if not known:
        return policy
    streams = tuple(replace(s, definitions=known[s.types]) if s.types else s for s in policy.streams)
    return replace(policy, streams=streams)
