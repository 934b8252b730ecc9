"""What bounds how many of a stream's samples count: debounce and the sampling limit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.planning.conditions.timers import SAME_INSTANT

if TYPE_CHECKING:
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.stream_spec import Stream


class GateListener(Protocol):
    """Receives the samples that count."""

    def deliver(self, value: dict[str, Any], now: float) -> None:
        """A sample passed."""


class Gate:
    """Debounce and the sampling limit: both hold the newest sample back and pass it when its time has come."""

    def __init__(self, spec: Stream, listener: GateListener, timers: Timers) -> None:
        self._spec, self._listener, self._timers = spec, listener, timers
        self._held: dict[str, Any] | None = None
        self._open_at = -math.inf

    def admit(self, value: dict[str, Any], now: float) -> None:
        """Pass a sample, now or later."""
        if self._spec.debounce:
            self._held = value
            self._timers.set(self, max(now + self._spec.debounce, self._open_at))
        elif now < self._open_at - SAME_INSTANT:
            self._held = value
            self._timers.set(self, self._open_at)
        else:
            self._pass(value, now)

    def empty(self) -> None:
        """Forget the sample held back."""
        self._held = None
        self._timers.clear(self)

    def adopt(self, old: Gate) -> None:
        """Hold back what the same gate of the policy's last version held."""
        self._held, self._open_at = old._held, old._open_at
        self._timers.adopt(old._timers, old, self)

    def on_due(self, now: float) -> None:
        """The time of the sample held back has come."""
        if self._held is not None:
            self._pass(self._held, now)

    def _pass(self, value: dict[str, Any], now: float) -> None:
        if self._held is not None:
            self.empty()
        self._open_at = now + self._spec.sample_every
        self._listener.deliver(value, now)
