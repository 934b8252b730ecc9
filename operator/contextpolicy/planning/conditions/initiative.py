"""Event-driven initiatives and pre-conditions: a value that holds while its event is fresh (paper III, IV-D)."""

from __future__ import annotations

import itertools
import math
from collections import deque
from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.conditions import expressions
from contextpolicy.planning.conditions.timers import SAME_INSTANT

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Activity

DECAY_STEPS = 10
"""A decaying score falls in this many steps: a plan for each, and none in between."""
MAX_EVENTS = 1000
"""Events that an initiative remembers, each weaker than the one before; once full, a new one replaces the newest."""


class ActivityListener(expressions.ExpressionListener, Protocol):
    """What an initiative tells the planner."""

    def on_score(self, initiative: Initiative, now: float) -> None:
        """The value changed."""


class Initiative:
    """The value of one `Activity` over time; a pre-condition is one with score 1.

    It is that of its strongest event: an event counts in full until it ends, then less and less while it decays.
    """

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
        self.when = expressions.Guarded(scope.compile(spec.when), scope, listener)
        self.score = expressions.Guarded(scope.compile(spec.score_from), scope, listener) if spec.score_from else None
        asked = [own.expression for own in (self.when, self.score) if own]
        names = {name for own in asked for name in own.variables} | ({spec.stream} if spec.stream else set())
        self.streams = tuple(streams[name] for name in sorted(names))
        self.source = ", ".join(stream.spec.name for stream in self.streams) or spec.initiative or "start"
        """What moves it, for people to read."""
        self._timers, self._listener = timers, listener
        self.carrier = streams[spec.stream] if spec.stream else None
        ages = [age for own in asked for age in own.ages]
        self._ageing = expressions.Ageing(ages, scope, timers, self) if ages else None
        self.matches = False
        """Whether the condition was true when last evaluated."""
        self._events: deque[_Event] = deque()
        """Strongest first, and each ends before the next: an event weaker than a later one can't matter again."""

    def start(self, now: float) -> None:
        """Decide at once what needs no sample."""
        self.on_value(now)

    def adopt(self, old: Initiative, now: float) -> None:
        """Continue the same activity, on the same streams, of the policy's previous version."""
        self.value, self._events, self.matches = old.value, old._events, old.matches
        self._timers.adopt(old._timers, old, self)
        self.when.adopt(old.when)
        if self.score and old.score:
            self.score.adopt(old.score)
        if self._ageing:
            self._ageing.arm(now)

    def on_value(self, now: float) -> None:
        """A stream that it reads has a new value, or lost its value."""
        if self.spec.initiative is not None:
            if self.carrier and not self.carrier.fresh:
                self._fall(now)
            return
        score = self._current(now)
        if score > 0:
            self._rise(score, now)
        elif not self.spec.hold:
            self._fall(now)
        if self._ageing:
            self._ageing.arm(now)

    def set(self, score: float, now: float) -> None:
        """A plugged-in instantiation function produced a score."""
        if score > 0:
            self._rise(score, now)
        else:
            self._fall(now)

    def on_due(self, now: float) -> None:
        """The strongest event ends, or falls another step: the next one may be stronger now."""
        events = self._events
        while events and self._is_outdone(now):
            events.popleft()
        self._settle(now)

    def _is_outdone(self, now: float) -> bool:
        """Whether nothing is left of the first event, or no more than of the second."""
        for event in itertools.islice(self._events, 2):
            event.pass_by(now, self.spec.decay)
        second = self._events[1].value if len(self._events) > 1 else 0.0
        return self._events[0].value <= second

    def _current(self, now: float) -> float:
        self.matches = (self.carrier is None or self.carrier.fresh) and self.when.truth(now)
        if not self.matches:
            return 0.0
        return self.score.number(now) if self.score else self.spec.score

    def _rise(self, score: float, now: float) -> None:
        until = now + self.spec.hold if self.spec.hold else math.inf
        events = self._events
        if len(events) == 1 and events[0].gives_way_to(score):  # nearly every sample: reuse the event
            events[0].score, events[0].until = score, until
            if self.spec.hold or self.spec.decay:
                self._wait()
            self._become(score, now)
        else:
            self._add(_Event(score, until), now)
            self._settle(now)

    def _add(self, event: _Event, now: float) -> None:
        events = self._events
        if events and events[-1].until == math.inf:
            events.pop()  # without `hold` only the newest sample counts
        while events:
            events[-1].pass_by(now, self.spec.decay)
            if events[-1].value > event.score:
                break
            events.pop()
        if len(events) == MAX_EVENTS:
            events.pop()
        events.append(event)

    def _fall(self, now: float) -> None:
        """End what is in force; events that already decay go on."""
        in_force = [event for event in self._events if event.until > now]
        if not in_force:
            return
        self._events = deque(event for event in self._events if event.until <= now)
        if self.spec.decay:
            # All of them would decay from now on, so the strongest stays ahead of the others: they can be dropped.
            in_force[0].until = now
            self._events.append(in_force[0])
        self._settle(now)

    def _settle(self, now: float) -> None:
        """Take the strongest event's value, and wait for its next change."""
        self._wait()
        self._become(self._events[0].value if self._events else 0.0, now)

    def _wait(self) -> None:
        due = self._events[0].next_change(self.spec.decay) if self._events else math.inf
        if due < math.inf:
            self._timers.set(self, due)
        else:
            self._timers.clear(self)

    def _become(self, value: float, now: float) -> None:
        if value != self.value:
            self.value = value
            self._listener.on_score(self, now)


class _Event:
    """A score that counts in full until a moment, then less with each step of the decay."""

    __slots__ = ("score", "steps", "until")

    def __init__(self, score: float, until: float) -> None:
        self.score, self.until = score, until
        self.steps = 0

    @property
    def value(self) -> float:
        return self.score * (DECAY_STEPS - self.steps) / DECAY_STEPS if self.steps else self.score

    def gives_way_to(self, score: float) -> bool:
        """Whether a new event of this score leaves nothing of this one."""
        return self.until == math.inf or (self.score <= score and not self.steps)

    def next_change(self, decay: float) -> float:
        return self.until + (self.steps + 1) * decay / DECAY_STEPS if decay else self.until

    def pass_by(self, now: float, decay: float) -> None:
        """Take all steps due by now. They are counted: from the clock, a step could round to the one before."""
        while self.steps < DECAY_STEPS and self.next_change(decay) <= now + SAME_INSTANT:
            self.steps = self.steps + 1 if decay else DECAY_STEPS
