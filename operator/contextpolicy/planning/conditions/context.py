"""One context over time: its condition, the delays that keep it from flapping, and what overrides it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.conditions import expressions

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Context


class ContextListener(expressions.ExpressionListener, Protocol):
    """What a context tells the planner."""

    def on_context(self, context: ContextState, now: float) -> None:
        """The context began or ceased to hold."""


class ContextState:
    """Whether a context holds.

    It holds `enterAfter` after its condition became true and stayed so, and ceases `exitAfter` after it became false
    and stayed so. A condition that can't be decided, because a stream has no value, is false.
    """

    def __init__(
        self, spec: Context, streams: dict[str, StreamState], scope: Scope, timers: Timers, listener: ContextListener
    ) -> None:
        self.spec = spec
        self.holds = False
        self.insisted: set[str] = set()
        self._timers, self._listener = timers, listener
        self.when = expressions.Guarded(scope.compile(spec.when), scope, listener) if spec.when else None
        asked = self.when.expression if self.when else None
        self.streams = tuple(streams[name] for name in sorted(asked.variables)) if asked else ()
        self._ageing = expressions.Ageing(asked.ages, scope, timers, self) if asked and asked.ages else None
        self._turning = False

    @property
    def active(self) -> bool:
        """Whether the context has effects: its condition holds, or it is the fallback or forced."""
        return self.holds or bool(self.insisted)

    @property
    def turns_at(self) -> float | None:
        """When it begins or ceases to hold if its condition stays as it is."""
        return self._timers.due(self)

    def start(self, now: float) -> None:
        """Decide at once what needs no sample."""
        self.on_value(now)

    def adopt(self, old: ContextState, now: float) -> None:
        """Continue the same condition, on the same streams, of the policy's previous version.

        Edited delays start over; a context that holds need not be entered again.
        """
        self.holds = old.holds
        if self.when and old.when:
            self.when.adopt(old.when)
        if (old.spec.enter_after, old.spec.exit_after) == (self.spec.enter_after, self.spec.exit_after):
            self._turning = old._turning
            self._timers.adopt(old._timers, old, self)
        self.on_value(now)

    def on_value(self, now: float) -> None:
        """A stream that it reads has a new value, or lost its value."""
        if self.when is None:
            return
        wanted = self.when.truth(now)
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
        if self._ageing:
            self._ageing.arm(now)

    def on_due(self, now: float) -> None:
        """The condition stayed as it is for long enough."""
        self._turn(now)

    def insist(self, reason: str, now: float) -> None:
        """Make it active whatever the sensors say: as fallback, or by hand."""
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
