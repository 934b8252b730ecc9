"""One stream inside the planner: which samples count, what the expressions see, and whether the stream is silent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.features import Window
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.conditions.source_clock import IGNORED, SourceClock
from contextpolicy.planning.conditions.timers import SAME_INSTANT

if TYPE_CHECKING:
    from typing import Any

    from contextpolicy.planning.conditions.sample import Sample
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Stream


UNHEARD = 3600.0
"""Seconds without a sample after which the status says so, even of a stream without `staleAfter`. Nothing else follows
from it: an emergency button may be silent for months."""


class StreamListener(Protocol):
    """What a stream tells the planner."""

    def on_value(self, stream: StreamState, now: float) -> None:
        """The stream's variable has a new value."""

    def on_silence(self, stream: StreamState, now: float) -> None:
        """The stream has no value any more."""

    def on_recovery(self, stream: StreamState, now: float) -> None:
        """A silent stream is heard again."""

    def on_first_value(self, stream: StreamState) -> None:
        """A stream without a value has one now."""

    def on_unheard(self, stream: StreamState) -> None:
        """A stream without `staleAfter` had no sample for UNHEARD, or is heard again."""

    def on_clock(self, stream: StreamState) -> None:
        """The stream's timestamps turned out to come from another clock, or from ours again."""

    def on_drop(self, stream: str, reason: str, detail: str = "") -> None:
        """A sample, or only its timestamp, was not used; `reason` is one of a fixed few, `detail` explains it."""


class StreamState:
    """A stream's gate (order, age, debounce, sampling limit, filter), features and watchdog."""

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
        self.unheard = False
        self._shared, self._own = scope, Scope()
        self._timers, self._listener = timers, listener
        self._filter = self._own.compile(spec.filter) if spec.filter else None
        self._windows = [Window(feature, self._own) for feature in spec.features]
        self._gate = _Gate(self, timers)
        self._sliding, self._absence = _Sliding(self), _Absence(self)
        self._features: dict[str, float] = {}
        self._valued_at = -math.inf

    def start(self, now: float) -> None:
        """Begin to wait for the first sample."""
        self.absent_since = now
        if self.spec.stale_after is not None:
            self._timers.set(self, now + self.spec.stale_after)
        else:
            self._timers.set(self._absence, now + UNHEARD)

    @property
    def unknown(self) -> bool:
        """Whether it is still undecided if the stream is heard or silent."""
        return self.spec.stale_after is not None and self.seen_at is None and not self.silent

    def adopt(self, old: StreamState, now: float) -> None:
        """Continue the same stream of the policy's previous version: window, gate, watchdog, clock and value."""
        self.seen_at, self.clock, self.absent_since = old.seen_at, old.clock, old.absent_since
        self.seen = old.seen
        self.fresh, self.silent, self.value = old.fresh, old.silent, old.value
        self.unheard = old.unheard
        self._windows, self._own, self._filter = old._windows, old._own, old._filter
        self._features, self._valued_at = old._features, old._valued_at
        self._gate.adopt(old._gate)
        for former, own in ((old, self), (old._sliding, self._sliding), (old._absence, self._absence)):
            self._timers.adopt(old._timers, former, own)
        if self.value is not None:
            self._resume(self.value, now)

    def observe(self, sample: Sample, now: float) -> None:
        """Take a sample as it arrives."""
        self.seen += 1
        reason = self._untimely(sample, now)
        if reason is not None:
            self._listener.on_drop(self.spec.name, reason)
            return
        self.seen_at = now
        if self.silent:
            self.silent = False
            self._listener.on_recovery(self, now)
        if self.unheard:
            self.unheard = False
            self._timers.set(self._absence, now + UNHEARD)
            self._listener.on_unheard(self)
        if self.spec.stale_after is not None:
            self._timers.set(self, now + self.spec.stale_after)
        self._gate.admit(sample.value, now)

    def deliver(self, value: dict[str, Any], now: float) -> None:
        """Make a sample that passed the gate the stream's value, unless the filter drops it."""
        try:
            if self._filter or self._windows:
                self._own.bind(self.spec.name, value)
            if self._filter and not self._filter.truth(self._own):
                self._listener.on_drop(self.spec.name, "filtered")
                return
            # Read all before adding any: a sample that fails must not end up in some of the windows.
            numbers = [window.read(self._own) for window in self._windows]
            for window, number in zip(self._windows, numbers, strict=True):
                window.add(number, now)
            self._bind(value, now)
        except ExpressionError as error:
            self._listener.on_drop(self.spec.name, "expression", str(error))
            return
        self._listener.on_value(self, now)

    def slide(self, now: float) -> None:
        """The oldest sample left a window: readers evaluate again if that changed a feature."""
        before = self._features
        if self.value is not None and self.fresh and self._measure(now) != before:
            self._share(self.value, self._valued_at)
            self._listener.on_value(self, now)

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
        if not was_silent:
            self._listener.on_silence(self, now)

    def check_absence(self, now: float) -> None:
        """An hour may be over without a sample; samples do not move this timer, so it looks when the last one came."""
        due = (now if self.seen_at is None else self.seen_at + UNHEARD) - SAME_INSTANT
        if now < due:
            self._timers.set(self._absence, due)
        else:
            self.unheard = True
            self._listener.on_unheard(self)

    def features(self, now: float) -> dict[str, float | None]:
        """The features as expressions see them at `now`."""
        return {window.feature.name: window.value(now) for window in self._windows}

    def _bind(self, value: dict[str, Any], now: float) -> None:
        if self._windows:
            self._measure(now)
        self._share(value, now)
        self.value, self._valued_at = value, now
        if not self.fresh:
            self.fresh, self.absent_since = True, None
            self._listener.on_first_value(self)

    def _share(self, value: dict[str, Any], at: float) -> None:
        """Show expressions the sample of `at` with the features; ExpressionError if CEL can't represent it."""
        if not self._windows:
            self._shared.bind(self.spec.name, value, at)
            return
        lacking = [f.name for f in self.spec.features if f.name not in self._features]
        fields = {**value, **self._features}
        # A sample's own field must not stand in for a feature of the same name that has no value.
        for name in lacking:
            fields.pop(name, None)
        self._shared.bind(self.spec.name, fields, at, lacking)

    def _resume(self, value: dict[str, Any], now: float) -> None:
        """Show the old sample to new expressions: they may read fields of it that CEL can't represent."""
        try:
            self._share(value, self._valued_at)
        except ExpressionError:
            self._listener.on_drop(self.spec.name, "expression")
            self.fresh, self.absent_since = False, now
        if not self.fresh:
            self._shared.unbind(self.spec.name)

    def _measure(self, now: float) -> dict[str, float]:
        """Update the features to `now`, and set a timer for when the next sample leaves a window."""
        values = self.features(now)
        self._features = {name: value for name, value in values.items() if value is not None}
        moments = [due for window in self._windows if (due := window.next_change()) is not None]
        if moments:
            self._timers.set(self._sliding, min(moments))
        return self._features

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


class _Gate:
    """Debounce and the sampling limit: both hold the newest sample back and pass it when its time has come."""

    def __init__(self, stream: StreamState, timers: Timers) -> None:
        self._stream, self._timers = stream, timers
        self._held: dict[str, Any] | None = None
        self._open_at = -math.inf

    def admit(self, value: dict[str, Any], now: float) -> None:
        spec = self._stream.spec
        if spec.debounce:
            self._held = value
            self._timers.set(self, max(now + spec.debounce, self._open_at))
        elif now < self._open_at - SAME_INSTANT:
            self._held = value
            self._timers.set(self, self._open_at)
        else:
            self._pass(value, now)

    def empty(self) -> None:
        """Forget the sample held back."""
        self._held = None
        self._timers.clear(self)

    def adopt(self, old: _Gate) -> None:
        """Hold back what the same gate of the policy's last version held."""
        self._held, self._open_at = old._held, old._open_at
        self._timers.adopt(old._timers, old, self)

    def on_due(self, now: float) -> None:
        if self._held is not None:
            self._pass(self._held, now)

    def _pass(self, value: dict[str, Any], now: float) -> None:
        if self._held is not None:
            self.empty()
        self._open_at = now + self._stream.spec.sample_every
        self._stream.deliver(value, now)


class _Sliding:
    """The moment at which the oldest sample leaves a stream's windows."""

    def __init__(self, stream: StreamState) -> None:
        self._stream = stream

    def on_due(self, now: float) -> None:
        self._stream.slide(now)


class _Absence:
    """The moment at which a stream without `staleAfter` may have had no sample for an hour."""

    def __init__(self, stream: StreamState) -> None:
        self._stream = stream

    def on_due(self, now: float) -> None:
        self._stream.check_absence(now)
