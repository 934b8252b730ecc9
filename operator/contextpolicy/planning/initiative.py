"""Event-driven initiatives and pre-conditions: a value that holds while its event is fresh (paper III, IV-D)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning import expressions
from contextpolicy.planning.stream import all_fresh

if TYPE_CHECKING:
    from contextpolicy.planning.expressions import Scope
    from contextpolicy.planning.stream import StreamState
    from contextpolicy.planning.timers import Timers
    from contextpolicy.policy.spec import Activity

DECAY_STEPS = 10
"""A decaying score falls in this many steps: a plan for each, and none in between."""


class ActivityListener(expressions.ExpressionListener, Protocol):
    """What an initiative tells the planner."""

    def on_score(self, initiative: Initiative, now: float) -> None:
        """The value changed."""


class Initiative:
    """The value of one `Activity` over time; a pre-condition is one with score 1."""

    def __init__(
        self,
        spec: Activity,
        streams: dict[str, StreamState],
        scope: Scope,
        timers: Timers,
        listener: ActivityListener,
    ) -> None:
        self.spec = spec
        self.value = 0.0
        self._timers, self._listener = timers, listener
        self._when = expressions.Guarded(scope.compile(spec.when), scope, listener)
        self._score = expressions.Guarded(scope.compile(spec.score_from), scope, listener) if spec.score_from else None
        names = self._when.variables | (self._score.variables if self._score else set()) | ({spec.stream} - {None})
        self.streams = tuple(streams[name] for name in sorted(str(name) for name in names))
        self._peak = 0.0
        self._falls_from: float | None = None
        self._steps = 0

    def start(self, now: float) -> None:
        """An activity that reads no stream is in force from the beginning."""
        if not self.streams and self.spec.initiative is None:
            self.on_value(now)

    def on_value(self, now: float) -> None:
        """A stream it reads has a new value; without a value of every stream nothing is in force."""
        if self.spec.initiative is not None:
            return
        score = self._current() if all_fresh(self.streams) else 0.0
        if score > 0:
            self._rise(score, now)
        elif not self.spec.hold:
            self._fall(now)

    def set(self, score: float, now: float) -> None:
        """A plugged-in instantiation function produced a score."""
        if score > 0:
            self._rise(score, now)
        else:
            self._fall(now)

    def on_silence(self, now: float) -> None:
        """A stream it reads fell silent: its event is no longer fresh."""
        self._timers.clear(self)
        self._falls_from = None
        self._become(0.0, now)

    def on_due(self, now: float) -> None:
        """The hold is over, or the next step of the decay is due."""
        if self._falls_from is None:
            self._fall(now)
        else:
            self._step(self._falls_from, now)

    def _current(self) -> float:
        if not self._when.truth():
            return 0.0
        return self._score.number() if self._score else self.spec.score

    def _rise(self, score: float, now: float) -> None:
        if self.spec.hold:
            self._timers.set(self, now + self.spec.hold)
        elif self._falls_from is not None:
            self._timers.clear(self)
        self._peak, self._falls_from = score, None
        self._become(score, now)

    def _fall(self, now: float) -> None:
        """Begin to decay, unless it does already; without a decay the score is gone at once."""
        if not self.spec.decay or self.value == 0:
            self._falls_from = None
            self._become(0.0, now)
        elif self._falls_from is None:
            self._falls_from, self._steps = now, 0
            self._timers.set(self, now + self.spec.decay / DECAY_STEPS)

    def _step(self, since: float, now: float) -> None:
        """Fall one step: counted, since a step computed from the clock can be rounded back to the one before."""
        self._steps += 1
        if self._steps < DECAY_STEPS:
            self._timers.set(self, since + (self._steps + 1) * self.spec.decay / DECAY_STEPS)
        else:
            self._falls_from = None
        self._become(self._peak * (DECAY_STEPS - self._steps) / DECAY_STEPS, now)

    def _become(self, value: float, now: float) -> None:
        if value != self.value:
            self.value = value
            self._listener.on_score(self, now)
