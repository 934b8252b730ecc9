"""One stream inside the planner: which samples count, what the expressions see, and whether the stream is silent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.absence import Absence
from contextpolicy.planning.conditions.features import Features
from contextpolicy.planning.conditions.gate import Gate
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.conditions.source_clock import IGNORED, SourceClock
from contextpolicy.planning.conditions.sources import SOURCE, SOURCES, Sources

if TYPE_CHECKING:
    from typing import Any

    from contextpolicy.planning.conditions.sample import Sample
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.stream_spec import Stream


class StreamListener(Protocol):
    """What a stream reports to the planner."""

    def on_sample(self, stream: StreamState, now: float) -> None:
        """A sample counts: the stream's variable has a new value."""

    def on_slide(self, stream: StreamState) -> None:
        """A window slid: features have new values without a sample."""

    def on_silence(self, stream: StreamState, now: float) -> None:
        """The stream has no value any more."""

    def on_recovery(self, stream: StreamState, now: float) -> None:
        """A silent stream is heard again."""

    def on_first_value(self, stream: StreamState) -> None:
        """A stream without a value has one now."""

    def on_unheard(self, stream: StreamState) -> None:
        """A stream without `staleAfter` had no sample for an hour, or is heard again."""

    def on_clock(self, stream: StreamState) -> None:
        """The stream's timestamps turned out to come from another clock, or from ours again."""

    def on_drop(self, stream: str, reason: str, detail: str = "") -> None:
        """A sample, or only its timestamp, was not used; `reason` is one of a fixed few, `detail` explains it."""


class StreamState:
    """A stream's gate (order, age, debounce, sampling limit, filter), features, sources and watchdog."""

    def __init__(self, spec: Stream, scope: Scope, timers: Timers, listener: StreamListener) -> None:
        self.spec = spec
        self.value: dict[str, Any] | None = None
        self.seen_at: float | None = None
        self.seen = 0
        """How many samples came, timely or not."""
        self.absent_since: float | None = None
        self.clock = SourceClock(spec.clock, spec.stale_after)
        self.fresh = False
        self.silent = False
        self._shared, self._own = scope, Scope()
        self._timers, self._listener = timers, listener
        self._filter = self._own.compile(spec.filter) if spec.filter else None
        self._features = Features(spec.features, self._own) if spec.features else None
        self._gate = Gate(spec, self, timers)
        self._sliding, self._absence = _Sliding(self), Absence(self, timers)
        self._sources = Sources(spec) if spec.sources else None
        self._leaving = _Leaving(self)
        self._valued_at = -math.inf

    @property
    def unheard(self) -> bool:
        """Whether it has no `staleAfter`, and had no sample for an hour."""
        return self._absence.unheard

    def start(self, now: float) -> None:
        """Begin to wait for the first sample."""
        self.absent_since = now
        if self.spec.stale_after is not None:
            self._timers.set(self, now + self.spec.stale_after)
        else:
            self._absence.start(now)

    def adopt(self, old: StreamState, now: float) -> None:
        """Continue the same stream of the policy's previous version: window, gate, watchdog, clock and value."""
        self.seen_at, self.clock, self.absent_since = old.seen_at, old.clock, old.absent_since
        self.seen = old.seen
        self.fresh, self.silent, self.value = old.fresh, old.silent, old.value
        self._features, self._own, self._filter = old._features, old._own, old._filter
        self._valued_at = old._valued_at
        self._sources = old._sources
        self._gate.adopt(old._gate)
        self._absence.adopt(old._absence)
        for former, own in (
            (old, self),
            (old._sliding, self._sliding),
            (old._leaving, self._leaving),
        ):
            self._timers.adopt(old._timers, former, own)
        if self.value is not None:
            self._resume(self.value, now)

    def observe(self, sample: Sample, now: float) -> None:
        """Take a sample as it arrives."""
        self.seen += 1
        if self._sources:
            sample = self._from_source(self._sources, sample)
        reason = self._untimely(sample, now)
        if reason is not None:
            self._listener.on_drop(self.spec.name, reason)
            return
        self.seen_at = now
        if self.silent:
            self.silent = False
            self._listener.on_recovery(self, now)
        if self._absence.unheard:
            self._absence.end(now)
        if self.spec.stale_after is not None:
            self._timers.set(self, now + self.spec.stale_after)
        if self._sources:
            self._sources.hear(sample.value[SOURCE], now)
        self._gate.admit(sample.value, now)

    def deliver(self, value: dict[str, Any], now: float) -> None:
        """Make a sample that passed the gate the stream's value, unless the filter drops it."""
        try:
            if self._filter or self._features:
                self._own.bind(self.spec.name, value)
            if self._filter and not self._filter.truth(self._own):
                self._listener.on_drop(self.spec.name, "filtered")
                return
            self._make_room(value.get(SOURCE), now)
            refused = self._sources and self._sources.refusal(value)
            if refused:
                self._listener.on_drop(self.spec.name, refused)
                return
            if self._features:
                self._features.add(self._features.read(self._own), now)
            self._bind(value, now)
        except ExpressionError as error:
            self._listener.on_drop(self.spec.name, "expression", str(error))
            return
        self._listener.on_sample(self, now)

    def slide(self, now: float) -> None:
        """The oldest sample left a window: readers evaluate again if that changed a feature."""
        if self._features and self.value is not None and self.fresh and self._measure(self._features, now):
            self._share(self.value, self._valued_at)
            self._listener.on_slide(self)

    def let_leave(self, now: float) -> None:
        """A source may have been silent for `staleAfter`: drop it from the sources."""
        if self._sources and self.value is not None and self.fresh:
            self._make_room(None, now)
            self._wait_for_sources(self._sources)

    def lose(self, now: float) -> None:
        """The stream's liveliness token is gone: do not wait for `staleAfter`."""
        self._timers.clear(self)
        self.on_due(now)

    def on_due(self, now: float) -> None:
        """No sample for `staleAfter`."""
        was_silent, self.silent = self.silent, True
        if self.fresh:
            self.fresh, self.absent_since = False, now
            self._shared.unbind(self.spec.name)
        self.clock.forget_order()
        self._gate.empty()
        self._timers.clear(self._sliding)
        if self._sources:
            self._sources.clear()
        if not was_silent:
            self._listener.on_silence(self, now)

    def on_unheard(self) -> None:
        """The stream had no sample for an hour, or is heard again."""
        self._listener.on_unheard(self)

    def fields(self, sample: Sample) -> dict[str, Any]:
        """A sample's fields, with the name of its source where the stream keeps its sources apart."""
        return {**sample.value, SOURCE: self._sources.name(sample.key)} if self._sources else sample.value

    def features(self, now: float) -> dict[str, float | None]:
        """The features as expressions see them at `now`."""
        return self._features.values(now) if self._features else {}

    def _bind(self, value: dict[str, Any], now: float) -> None:
        if self._features:
            self._measure(self._features, now)
        if self._sources:
            self._bind_source(self._sources, value, now)
        else:
            self._share(value, now)
        self.value, self._valued_at = value, now
        if not self.fresh:
            self.fresh, self.absent_since = True, None
            self._listener.on_first_value(self)

    def _bind_source(self, sources: Sources, value: dict[str, Any], now: float) -> None:
        """Show the sample among those of the other sources; one that CEL can't represent must not spoil theirs."""
        before = sources.keep(value, self.clock, now)
        try:
            self._share(value, now)
        except ExpressionError:
            sources.put_back(value[SOURCE], before)
            raise
        self._wait_for_sources(sources)

    def _share(self, value: dict[str, Any], at: float) -> None:
        """Show expressions the sample of `at` with the features; ExpressionError if CEL can't represent it."""
        if self._sources:
            value = {**value, SOURCES: self._sources.samples()}
        if not self._features:
            self._shared.bind(self.spec.name, value, at)
            return
        fields, lacking = self._features.beside(value)
        self._shared.bind(self.spec.name, fields, at, lacking)

    def _make_room(self, speaking: str | None, now: float) -> None:
        """Let sources that are silent for `staleAfter` leave, before a sample of another at this instant counts."""
        if self._sources and self._sources.leave(now, speaking=speaking) and self.value is not None and self.fresh:
            self._share(self.value, self._valued_at)
            self._listener.on_slide(self)

    def _from_source(self, sources: Sources, sample: Sample) -> Sample:
        """The sample with the name of its source, whose clock judges it."""
        self.clock = sources.clock(sources.name(sample.key))
        return sample._replace(value=self.fields(sample))

    def _wait_for_sources(self, sources: Sources) -> None:
        due = sources.next_change()
        if due is not None:
            self._timers.set(self._leaving, due)

    def _resume(self, value: dict[str, Any], now: float) -> None:
        """Show the old sample to new expressions: they may read fields of it that CEL can't represent."""
        try:
            self._share(value, self._valued_at)
        except ExpressionError:
            self._listener.on_drop(self.spec.name, "expression")
            self.fresh, self.absent_since = False, now
        if not self.fresh:
            self._shared.unbind(self.spec.name)

    def _measure(self, features: Features, now: float) -> bool:
        """Bring the features to `now`, with a timer for when the next sample leaves a window; whether any changed."""
        changed, due = features.measure(now), features.next_change()
        if due is not None:
            self._timers.set(self._sliding, due)
        return changed

    def _untimely(self, sample: Sample, now: float) -> str | None:
        """Why a sample's own timestamp rules it out; None when it does not."""
        was_ours = self.clock.behind is None
        reason = self.clock.judge(sample.timestamp, now)
        if (self.clock.behind is None) is not was_ours:
            self._listener.on_clock(self)
        if reason == IGNORED:
            self._listener.on_drop(self.spec.name, reason)
            return None
        return reason


class _Sliding:
    """The moment at which the oldest sample leaves a stream's windows."""

    def __init__(self, stream: StreamState) -> None:
        self._stream = stream

    def on_due(self, now: float) -> None:
        self._stream.slide(now)


class _Leaving:
    """The moment at which one of a stream's sources may be silent for `staleAfter`."""

    def __init__(self, stream: StreamState) -> None:
        self._stream = stream

    def on_due(self, now: float) -> None:
        self._stream.let_leave(now)
