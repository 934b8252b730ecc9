"""Signed messages that were received before: the operator signs each message once, so a duplicate is a replay."""

from __future__ import annotations

import time
from threading import Lock
from typing import TYPE_CHECKING

from contextpolicy.bus.signatures import MAX_AGE
from contextpolicy.errors import OrderError

if TYPE_CHECKING:
    from collections.abc import Callable

FRESH = 2 * MAX_AGE
"""Seconds after which a message can't pass for fresh any more, even one by a clock that is ahead as far as may be."""


class Repetitions:
    """Remembers every message for as long as it would pass for fresh; called on any thread.

    Without it a replayed plan would only be dropped among those that wait, and never be reported.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, Lock()
        self._heard: dict[bytes, float] = {}

    def check(self, key: str, attachment: bytes) -> None:
        """Note a message whose signature is valid; OrderError when it was received before."""
        with self._lock:
            now = self._clock()
            self._forget(now - FRESH)
            again = attachment in self._heard
            self._heard.setdefault(attachment, now)
        if again:
            raise OrderError("Repeated", f"{key}: duplicate message: the operator signs each message only once")

    def _forget(self, before: float) -> None:
        """The oldest are first."""
        while self._heard:
            oldest = next(iter(self._heard))
            if self._heard[oldest] >= before:
                return
            del self._heard[oldest]
