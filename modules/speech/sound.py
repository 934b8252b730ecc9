"""Microphone chunks as one stream of sound, whatever their format: what was lost is concealed, its times are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.speech.forms import RateWatch, converter
from modules.speech.gate import BYTES_PER_SAMPLE
from modules.speech.spectrum import RATE
from robotkit import readings

if TYPE_CHECKING:
    from modules.speech.gate import Gate, Utterance
    from robotkit import Received

MAX_GAP_NS = 500_000_000
LEAST_GAP_NS = 50_000_000
"""Chunks may be stamped late by this much."""
_LOST = 0.75
"""Part of a chunk that has to be missing to be taken for a whole one."""


class SoundStream:
    """Feeds a gate with chunks; after a long gap it starts afresh instead of gluing two sounds together.

    What the bus lost is concealed by the chunk before it (as in ITU-T G.711 Appendix I, without its smoothing), or else
    all that follows would be cut into frames elsewhere, and doubtful commands be heard otherwise, however long after.
    Silence would teach the voice detector a background that no room has.
    """

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._taken = 0
        self._last = b""
        self._end: int | None = None
        self._form, self._converter = "", converter("")
        self._rate = RateWatch()

    def feed(self, received: Received) -> list[Utterance]:
        """Take a chunk, whose stamp is that of its end: a microphone delivers it when it is full."""
        samples = self._as_needed(received)
        count = len(samples) // BYTES_PER_SAMPLE
        gap = 0 if self._end is None else received.stamp - count * 1_000_000_000 // RATE - self._end
        if gap > MAX_GAP_NS:
            self._gate.restart()
        elif gap > LEAST_GAP_NS:
            samples = self._last * _lost(gap, count) + samples
        self._last = samples[len(samples) - count * BYTES_PER_SAMPLE :]
        self._end = received.stamp
        self._taken += len(samples) // BYTES_PER_SAMPLE
        return self._gate.feed(samples)

    def _as_needed(self, received: Received) -> bytes:
        """Samples of 16 kHz, mono; MessageError when they are not and nothing says what they are."""
        samples = readings.sound(received)
        if received.encoding != self._form:
            self._converter, self._form = converter(received.encoding), received.encoding
        if self._converter is not None:
            return self._converter.convert(samples)
        self._rate.check(received.stamp, len(samples) // BYTES_PER_SAMPLE)
        return samples

    def time_of(self, moment: float) -> float:
        """When a moment after the last gap was, in s since 1970; the gate counts it in seconds of sound."""
        return (self._end or 0) / 1e9 - (self._taken / RATE - moment)


def _lost(gap: int, count: int) -> int:
    """How many chunks of so many samples are missing from a gap of so many ns."""
    return int(gap * RATE / (count * 1_000_000_000) + 1 - _LOST) if count else 0
