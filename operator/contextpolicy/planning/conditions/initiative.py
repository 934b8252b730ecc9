"""Event-driven initiatives and pre-conditions: a value that holds while its event is fresh (paper III, IV-D)."""

from __future__ import annotations

import math
from collections import deque
from operator import attrgetter
from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.conditions import expressions
from contextpolicy.planning.conditions.timers import SAME_INSTANT
from contextpolicy.planning.conditions.turns import Turns

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.activities import Activity

DECAY_STEPS = 10
"""A decaying score falls in this many steps: a plan for each, and none in between."""
MAX_EVENTS = 1000
"""Events that an initiative remembers, each weaker than the one before; once full, a new one replaces the newest."""


class ActivityListener(expressions.ExpressionListener, Protocol):
    """What an initiative reports to the planner."""

    def on_score(self, initiative: Initiative, now: float) -> None:
        """The value changed."""


class Initiative:
    """The value of one `Activity` over time; a pre-condition is one with score 1.

    It is that of its strongest event: an event counts in full until it ends, then less and less while it decays. With
    `hold` only a sample is an event: time alone, such as a window that slides, can end one but neither begins nor
    renews it. Where no stream is read, a context that a sample made turn is the event. Without `hold`, or if it reads
    nothing that could ever turn, the condition decides at any time.
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
        self.line = " ".join(spec.when.split())
        """Its condition on one line, as causes show it."""
        self.value = 0.0
        self.when = expressions.Guarded(scope.compile(spec.when), scope, listener)
        self.score = expressions.Guarded(scope.compile(spec.score_from), scope, listener) if spec.score_from else None
        self.until = expressions.Guarded(scope.compile(spec.until), scope, listener) if spec.until else None
        asked = [own.expression for own in (self.when, self.until, self.score) if own]
        names = {name for own in asked for name in own.variables} | ({spec.stream} if spec.stream else set())
        self.streams = tuple(streams[name] for name in sorted(names))
        self.reads = frozenset[str]().union(*(own.contexts for own in asked))
        """The contexts that its expressions read."""
        moved_by = [*(stream.spec.name for stream in self.streams), *(f"context {name}" for name in sorted(self.reads))]
        self.source = ", ".join(moved_by) or spec.initiative or "start"
        """What moves it, for people to read."""
        self._timers, self._listener = timers, listener
        self._turns = Turns(self.reads, scope)
        self._hold = spec.hold if self.streams or self.reads or spec.initiative else 0.0
        self.carrier = streams[spec.stream] if spec.stream else None
        ages = [age for own in asked for age in own.ages]
        self._ageing = expressions.Ageing(ages, scope, timers, self, listener) if ages else None
        self.matches = False
        """Whether the condition was true when last evaluated; with `until` and no hold, whether it was since then."""
        self._ended = self._goes_on = False
        self._events: deque[_Event] = deque()
        """Each ends before the next, and none is weaker than a later one for good: it couldn't matter again.

        Without a decay the strongest is the first.
        """

    @property
    def deciding(self) -> expressions.Guarded:
        """The condition that decides whether it stays as it is."""
        return self.until if self.until and (self._goes_on or self._ended) else self.when

    @property
    def is_over(self) -> bool:
        """Whether time alone ended its last event, whatever the condition says now."""
        return bool(self._hold) and self.value == 0 and not self._ended

    def decays_from(self, now: float) -> float | None:
        """The score that its value is the rest of; None while an event counts in full."""
        strongest = max(self._events, key=attrgetter("value"), default=None)
        ended = strongest is not None and self.spec.decay > 0 and strongest.until <= now
        return strongest.score if strongest and ended else None

    def start(self, now: float) -> None:
        """Decide at once what needs no sample."""
        self.on_value(now)

    def adopt(self, old: Initiative, now: float) -> None:
        """Continue the same activity, on the same streams, of the policy's previous version."""
        self.value, self._events = old.value, old._events
        self.matches, self._goes_on = old.matches, old._goes_on
        self._turns.adopt(old._turns)
        self._timers.adopt(old._timers, old, self)
        for own, former in ((self.when, old.when), (self.until, old.until), (self.score, old.score)):
            if own and former:
                own.adopt(former)
        if self._ageing:
            self._ageing.arm(now)

    def on_value(self, now: float, *, sampled: bool = False) -> None:
        """What it reads may have changed: by a sample, which is an event, or by a lost value or time alone."""
        if self.spec.initiative is not None:
            if self.carrier and not self.carrier.fresh:
                self._fall(now)
            return
        is_event = sampled if self.streams else self._turns.by_sample()
        score = self._current(now)
        if score > 0:
            if is_event or not self._hold:
                self._rise(score, now)
        elif self._ended or not self._hold:
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
        """The strongest event ends, or falls another step: a later one may be stronger now."""
        if not self.spec.decay:
            while self._events and self._events[0].until <= now + SAME_INSTANT:
                self._events.popleft()
        self._settle(now)

    def _current(self, now: float) -> float:
        begins = (self.carrier is None or self.carrier.fresh) and self.when.truth(now)
        if self.until:
            self._ended = self.until.truth(now)
            begins = not self._ended and (begins or self._goes_on)
        self.matches = begins
        score = 0.0
        if begins:
            score = self.score.number(now) if self.score else self.spec.score
        # A score of 0 ends the event: only the condition begins it again.
        self._goes_on = score > 0 and not self._hold
        return score

    def _rise(self, score: float, now: float) -> None:
        until = now + self._hold if self._hold else math.inf
        events = self._events
        if len(events) == 1 and events[0].gives_way_to(score):  # nearly every sample: reuse the event
            events[0].score, events[0].until = score, until
            if self._hold or self.spec.decay:
                self._wait(events[0])
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
        if self.spec.decay:
            self._events = self._still_counting(now)
            strongest = max(self._events, key=attrgetter("value"), default=None)
        else:
            strongest = self._events[0] if self._events else None
        self._wait(strongest)
        self._become(strongest.value if strongest else 0.0, now)

    def _still_counting(self, now: float) -> deque[_Event]:
        """The events that have or will have more left than any later one.

        Of two that fall, the later one may take its next step first, and be the weaker one until the other's next step.
        What is left of the earlier one counts again only if it is more than that.
        """
        counting: deque[_Event] = deque()
        least = 0.0
        for event in reversed(self._events):
            event.pass_by(now, self.spec.decay)
            if event.value > least:
                counting.appendleft(event)
                least = max(least, event.next_value)
        return counting

    def _wait(self, strongest: _Event | None) -> None:
        due = strongest.next_change(self.spec.decay) if strongest else math.inf
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

    @property
    def next_value(self) -> float:
        """What a step of the decay leaves of it."""
        return self.score * (DECAY_STEPS - self.steps - 1) / DECAY_STEPS

    def gives_way_to(self, score: float) -> bool:
        """Whether a new event of this score leaves nothing of this one."""
        return self.until == math.inf or (self.score <= score and not self.steps)

    def next_change(self, decay: float) -> float:
        return self.until + (self.steps + 1) * decay / DECAY_STEPS if decay else self.until

    def pass_by(self, now: float, decay: float) -> None:
        """Take all steps due by now. They are counted: from the clock, a step could round to the one before."""
        while self.steps < DECAY_STEPS and self.next_change(decay) <= now + SAME_INSTANT:
            self.steps = self.steps + 1 if decay else DECAY_STEPS
