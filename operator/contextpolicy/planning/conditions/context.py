"""One context over time: its condition, the delays that keep it from flapping, and what overrides it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.conditions import expressions
from contextpolicy.planning.conditions.turns import Turns

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Context


class ContextListener(expressions.ExpressionListener, Protocol):
    """What a context reports to the planner."""

    def on_context(self, context: ContextState, now: float) -> None:
        """The context began or ceased to hold."""


class ContextState:
    """Whether a context holds.

    It holds `enterAfter` after its condition became true and stayed so, and ceases `exitAfter` after it became false
    and stayed so, or with `until` after that became true and stayed so. A condition that can't be decided, because a
    stream has no value, is false: between two thresholds a context stays as it is. While `until` holds it can't begin.
    """

    def __init__(
        self, spec: Context, streams: dict[str, StreamState], scope: Scope, timers: Timers, listener: ContextListener
    ) -> None:
        self.spec = spec
        self.holds = False
        self.insisted: set[str] = set()
        self._scope, self._timers, self._listener = scope, timers, listener
        self.when = expressions.Guarded(scope.compile(spec.when), scope, listener) if spec.when else None
        self.until = expressions.Guarded(scope.compile(spec.until), scope, listener) if spec.until else None
        asked = [own.expression for own in (self.when, self.until) if own]
        self.streams = tuple(streams[name] for name in sorted({name for own in asked for name in own.variables}))
        self.reads = frozenset[str]().union(*(own.contexts for own in asked))
        """The contexts that its conditions read."""
        moved_by = [*(stream.spec.name for stream in self.streams), *(f"context {name}" for name in sorted(self.reads))]
        self.source = ", ".join(moved_by) or "policy"
        """What moves it, for people to read."""
        self.moved_by = self.source
        """What did so last: for a fallback the stream that fell silent or is heard again."""
        ages = [age for own in asked for age in own.ages]
        self._ageing = expressions.Ageing(ages, scope, timers, self, listener) if ages else None
        self.by_sample = False
        """Whether a sample made it begin or cease to be active, be it after a delay; time and silence are none."""
        self._turns = Turns(self.reads, scope)
        self._turning = self._ended = False
        self._turned_at: float | None = None
        """When it last began or ceased to be active."""
        self._by_sample = False
        """Whether a sample began the change of its condition that it is about to follow."""

    @property
    def active(self) -> bool:
        """Whether the context has effects: its condition holds, or it is the fallback or forced."""
        return self.holds or bool(self.insisted)

    @property
    def deciding(self) -> expressions.Guarded | None:
        """The expression that decides whether it stays as it is."""
        return self.until if self.until and (self.holds or self._ended) else self.when

    @property
    def turns_at(self) -> float | None:
        """When it begins or ceases to hold if its condition stays as it is."""
        return self._timers.due(self)

    def start(self, now: float) -> None:
        """Decide at once what needs no sample."""
        if self.insisted:
            self._listener.on_context(self, now)
        self.on_value(now)

    def adopt(self, old: ContextState, now: float) -> None:
        """Continue the same condition, on the same streams, of the policy's previous version.

        Edited delays start over; a context that holds need not be entered again.
        """
        self.holds = old.holds
        if self.active is not old.active:
            self._listener.on_context(self, now)
        elif self.spec.name in self._scope.active:
            self._scope.show_context(self.spec.name, active=self.active)
        for own, former in ((self.when, old.when), (self.until, old.until)):
            if own and former:
                own.adopt(former)
        self._turns.adopt(old._turns)
        if (old.spec.enter_after, old.spec.exit_after) == (self.spec.enter_after, self.spec.exit_after):
            self._turning, self._by_sample = old._turning, old._by_sample
            self._timers.adopt(old._timers, old, self)
        self.on_value(now)

    def on_value(self, now: float, *, sampled: bool = False) -> None:
        """What it reads may have changed: a new value, a lost one, or time alone."""
        sampled = self._turns.by_sample() or sampled
        if self.when is None:
            return
        wanted = self.when.truth(now)
        if self.until:
            self._ended = self.until.truth(now)
            wanted = not self._ended and (wanted or self.holds)
        if wanted == self.holds:
            if self._turning:
                self._turning = False
                self._timers.clear(self)
        elif not self._turning:
            self._by_sample = sampled
            delay = self.spec.enter_after if wanted else self.spec.exit_after
            if delay:
                self._turning = True
                self._timers.set(self, now + delay)
            else:
                self._turn(now)
        elif self.turns_at is None:
            self._turn(now)
        if self._ageing:
            self._ageing.arm(now)

    def on_due(self, now: float) -> None:  # noqa: ARG002 - the timer's signature
        """The condition stayed as it is for long enough, unless this very instant changes it."""
        self._listener.on_elapsed(self)

    def insist(self, reason: str, now: float, *, moved_by: str | None = None) -> None:
        """Make it active whatever the sensors say: as fallback, or by hand."""
        was = self.active
        self.insisted.add(reason)
        self._tell(was=was, by_sample=False, moved_by=moved_by, now=now)

    def relent(self, reason: str, now: float, *, sampled: bool = False, moved_by: str | None = None) -> None:
        """Stop insisting for this reason; `sampled` says whether a sample is why."""
        was = self.active
        self.insisted.discard(reason)
        self._tell(was=was, by_sample=sampled, moved_by=moved_by, now=now)

    def _turn(self, now: float) -> None:
        was = self.active
        self._turning = False
        self.holds = not self.holds
        if was and self._by_sample and self._turned_at == now and self.active:
            # As silence made it active at this very instant, so did a sample.
            self.by_sample = True
            self._scope.turned_by_sample.add(self.spec.name)
        self._tell(was=was, by_sample=self._by_sample, moved_by=None, now=now)

    def _tell(self, *, was: bool, by_sample: bool, moved_by: str | None, now: float) -> None:
        if was != self.active:
            self._turned_at = now
            self.by_sample, self.moved_by = by_sample, moved_by or self.source
            self._listener.on_context(self, now)
