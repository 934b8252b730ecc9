"""Contexts that are active whatever their conditions say: as fallback while a stream is silent, or forced by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from contextpolicy.planning.conditions.context import ContextState
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Policy


class Overrides:
    """Those of one policy."""

    def __init__(
        self, policy: Policy, streams: Collection[StreamState], contexts: Sequence[ContextState], timers: Timers
    ) -> None:
        self._policy, self._streams, self._contexts, self._timers = policy, streams, contexts, timers

    def fall_back(self, now: float, *, stream: str | None = None, sampled: bool = False) -> None:
        """A stream may have fallen silent, or a sample be heard again."""
        silent = [stream.spec for stream in self._streams if stream.silent]
        fallbacks = {stream.fallback or self._policy.fallback for stream in silent}
        for context in self._contexts:
            if context.spec.name in fallbacks:
                context.insist("fallback", now, moved_by=stream)
            else:
                context.relent("fallback", now, sampled=sampled, moved_by=stream)

    def force(self, now: float, ahead: float) -> None:
        """Begin or end what `spec.force` says: `until` is a time of the wall clock, which can be set.

        Planning time is `ahead` seconds of it.
        """
        force = self._policy.force
        if force is None:
            return
        end = force.until + ahead
        for context in self._contexts:
            if context.spec.name == force.context and now < end:
                context.insist("forced", now)
                self._timers.set(self, end)
            elif context.spec.name == force.context:
                self.on_due(now)

    def forced(self) -> list[ContextState]:
        """The contexts that are forced now."""
        return [context for context in self._contexts if "forced" in context.insisted]

    def on_due(self, now: float) -> None:
        """The time for which a context was forced is over."""
        for context in self._contexts:
            context.relent("forced", now)
