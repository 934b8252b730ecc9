"""An edit keeps what it did not change: what a planner takes over from that of the policy's previous version.

A part is unchanged if its spec is equal and so are all streams and contexts that it reads. It keeps its state, timers
included.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.planning.conditions.context import ContextState

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from contextpolicy.planning.conditions.evaluation import Reader
    from contextpolicy.planning.conditions.initiative import Initiative
    from contextpolicy.planning.conditions.scores import Scores
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.policy.stream_spec import Stream


class Inheritance:
    """What the previous version leaves: its streams, its contexts and its initiatives, each with its task."""

    def __init__(
        self,
        streams: Mapping[str, StreamState],
        contexts: Iterable[ContextState],
        initiatives: Iterable[tuple[Initiative, str]],
    ) -> None:
        self._streams = streams
        self._contexts = {context.spec.name: context for context in contexts}
        self._initiatives = list(initiatives)
        self._same: set[str] = set()
        self._same_contexts: set[str] = set()

    def pass_on_stream(self, stream: StreamState, now: float) -> None:
        """Call this for all streams first: whether a reader is unchanged depends on its streams."""
        old = self._streams.get(stream.spec.name)
        if old is not None and _reading(old) == _reading(stream):
            self._same.add(stream.spec.name)
            stream.adopt(old, now)

    def pass_on(self, reader: Reader, scores: Scores, now: float) -> bool:
        """Returns whether the reader goes on as an unchanged one of the previous version; `scores` are the new ones.

        Call this for a reader after all contexts that it reads.
        """
        if isinstance(reader, ContextState):
            return self._pass_on_context(reader, now)
        inherits = self._pass_on_initiative(reader, scores.owner(reader), now)
        if inherits:
            scores.update(reader)
        return inherits

    def _pass_on_initiative(self, initiative: Initiative, task: str, now: float) -> bool:
        """Returns whether the task had it before; of several equal ones, each passes its state on once."""
        for index, (old, owner) in enumerate(self._initiatives):
            if owner == task and old.spec == initiative.spec and self._are_same(old):
                del self._initiatives[index]
                initiative.adopt(old, now)
                return True
        return False

    def _pass_on_context(self, context: ContextState, now: float) -> bool:
        """Returns whether there was a context of this name with the same condition."""
        old = self._contexts.get(context.spec.name)
        if old is None or _condition(old) != _condition(context) or not self._are_same(old):
            return False
        self._same_contexts.add(context.spec.name)
        context.adopt(old, now)
        return True

    def _are_same(self, old: ContextState | Initiative) -> bool:
        """Whether all that it reads is unchanged."""
        return self._same.issuperset(s.spec.name for s in old.streams) and self._same_contexts >= old.reads


def _condition(context: ContextState) -> tuple[str | None, str | None]:
    return context.spec.when, context.spec.until


def _reading(stream: StreamState) -> Stream:
    """How it is read; the fallback matters to others only."""
    return replace(stream.spec, fallback=None)
