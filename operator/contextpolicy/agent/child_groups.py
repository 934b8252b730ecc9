"""The child groups of cgroups, as the kernel lists them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Container

_LEAST_LINKS = 2
"""Of a directory, where children are counted at all: its own name and its `.`."""


class Children:
    """The child groups of groups, listed again only when their number has changed: the kernel counts them as links."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, list[Path]]] = {}

    def of(self, group: Path) -> list[Path]:
        """The child groups; none when the group is gone."""
        try:
            links = group.stat().st_nlink
        except OSError:
            links = 0
        known = self._known.get(group)
        if known is None or known[0] != links or links < _LEAST_LINKS:
            known = self._known[group] = links, children(group)
        return known[1]

    def forget(self, group: Path) -> None:
        """One child has ended, so that another may have come without a change of their number."""
        self._known.pop(group, None)

    def all(self) -> list[Path]:
        """The child groups of all groups, as they were last found."""
        return [child for _, found in self._known.values() for child in found]

    def keep(self, groups: Container[Path]) -> None:
        """Forget all other groups."""
        for group in [group for group in self._known if group not in groups]:
            del self._known[group]


def children(group: Path) -> list[Path]:
    """The child groups; none when the group is gone."""
    try:
        return [Path(entry.path) for entry in os.scandir(group) if entry.is_dir(follow_symlinks=False)]
    except OSError:
        return []
