"""Which contexts turned, and whether a sample made them turn: only samples are events."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.scope import Scope


class Turns:
    """What one reader has seen of the contexts that it reads."""

    def __init__(self, reads: frozenset[str], scope: Scope) -> None:
        self._reads, self._scope = reads, scope
        self._seen: frozenset[str] | None = None
        """Those that were active when last looked at; None before that."""

    def adopt(self, old: Turns) -> None:
        """Go on from what the same reader of the policy's previous version saw."""
        self._seen = old._seen

    def by_sample(self) -> bool:
        """Whether a sample made one turn since last asked: one that ended and began at one instant went on."""
        if not self._reads:
            return False
        before, self._seen = self._seen, frozenset(filter(self._scope.active.get, self._reads))
        return before is not None and not self._scope.turned_by_sample.isdisjoint(before ^ self._seen)
