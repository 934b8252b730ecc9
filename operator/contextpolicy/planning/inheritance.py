"""An edit keeps what it did not change: what a planner takes over from that of the policy's previous version.

A part is unchanged if its spec is equal and so are all streams that it reads. It keeps its state, timers included.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from contextpolicy.planning.conditions.context import ContextState
    from contextpolicy.planning.conditions.initiative import Initiative
    from contextpolicy.planning.conditions.stream import StreamState


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

    def pass_on_stream(self, stream: StreamState, now: float) -> None:
        """Call this for all streams first: whether a reader is unchanged depends on its streams."""
        old = self._streams.get(stream.spec.name)
        if old is not None and old.spec == stream.spec:
            self._same.add(stream.spec.name)
            stream.adopt(old, now)

    def pass_on_initiative(self, initiative: Initiative, task: str, now: float) -> bool:
        """Returns whether the task had it before; of several equal ones, each passes its state on once."""
        for index, (old, owner) in enumerate(self._initiatives):
            if owner == task and old.spec == initiative.spec and self._are_same(old.streams):
                del self._initiatives[index]
                initiative.adopt(old, now)
                return True
        return False

    def pass_on_context(self, context: ContextState, now: float) -> bool:
        """Returns whether there was a context of this name with the same condition."""
        old = self._contexts.get(context.spec.name)
        if old is None or old.spec.when != context.spec.when or not self._are_same(old.streams):
            return False
        context.adopt(old, now)
        return True

    def _are_same(self, streams: tuple[StreamState, ...]) -> bool:
        return all(stream.spec.name in self._same for stream in streams)
