"""One context over time: its condition, the delays that keep it from flapping, the hand that forces it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning import expressions
from contextpolicy.planning.stream import all_fresh

if TYPE_CHECKING:
    from contextpolicy.planning.expressions import Scope
    from contextpolicy.planning.stream import StreamState
    from contextpolicy.planning.timers import Timers
    from contextpolicy.policy.spec import Context


class ContextListener(expressions.ExpressionListener, Protocol):
    """What a context tells the planner."""

    def on_context(self, context: ContextState, now: float) -> None:
        """The context began or ceased to hold."""


class ContextState:
    """Whether a context holds.

    It holds `enterAfter` after its condition became true and stayed so, and ceases `exitAfter` after it became false
    and stayed so. A silent stream ends it at once: a value that is not there cannot be waited for.
    """

    def __init__(
        self, spec: Context, streams: dict[str, StreamState], scope: Scope, timers: Timers, listener: ContextListener
    ) -> None:
        self.spec = spec
        self.holds = False
        self.insisted: set[str] = set()
        self._timers, self._listener = timers, listener
        self._when = expressions.Guarded(scope.compile(spec.when), scope, listener) if spec.when else None
        self.streams = tuple(streams[name] for name in sorted(self._when.variables)) if self._when else ()
        self._turning = False

    @property
    def active(self) -> bool:
        """Whether the context has effects: its condition holds, or it is the fallback or forced."""
        return self.holds or bool(self.insisted)

    def start(self, now: float) -> None:
        """A condition over no stream is decided at the beginning."""
        if self._when and not self.streams:
            self.on_value(now)

    def adopt(self, old: ContextState) -> None:
        """Hold on if the same condition held in the policy's last version and still does: no second `enterAfter`."""
        if old.holds and not self.holds and all(stream.fresh for stream in self.streams) and self._truth():
            self._timers.clear(self)
            self._turning, self.holds = False, True

    def on_value(self, now: float) -> None:
        """A stream it reads has a new value."""
        wanted = all_fresh(self.streams) and self._truth()
        if wanted == self.holds:
            if self._turning:
                self._turning = False
                self._timers.clear(self)
        elif not self._turning:
            delay = self.spec.enter_after if wanted else self.spec.exit_after
            if delay:
                self._turning = True
                self._timers.set(self, now + delay)
            else:
                self._turn(now)

    def on_silence(self, now: float) -> None:
        """A stream it reads fell silent."""
        self._turning = False
        self._timers.clear(self)
        if self.holds:
            self._turn(now)

    def on_due(self, now: float) -> None:
        """The condition stayed as it is for long enough."""
        self._turn(now)

    def insist(self, reason: str, now: float) -> None:
        """Let it hold whatever the sensors say: as fallback, or by hand."""
        was = self.active
        self.insisted.add(reason)
        if not was:
            self._listener.on_context(self, now)

    def relent(self, reason: str, now: float) -> None:
        """Stop insisting for this reason."""
        was = self.active
        self.insisted.discard(reason)
        if was != self.active:
            self._listener.on_context(self, now)

    def _turn(self, now: float) -> None:
        was = self.active
        self._turning = False
        self.holds = not self.holds
        if was != self.active:
            self._listener.on_context(self, now)

    def _truth(self) -> bool:
        return self._when is not None and self._when.truth()
