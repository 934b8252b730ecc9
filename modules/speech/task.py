"""From microphone chunks to keywords."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.speech.spotter import BYTES_PER_SAMPLE, RATE
from robotkit import MessageError, Task

if TYPE_CHECKING:
    from modules.speech.spotter import Spotter
    from robotkit import Received

MAX_GAP_NS = 500_000_000


class Speech(Task):
    """Hears commands; after a gap in the audio it starts afresh instead of gluing two sounds together."""

    def __init__(self, spotter: Spotter) -> None:
        self._spotter = spotter
        self._end: int | None = None

    def process(self, received: Received) -> dict[str, object] | None:
        """Give a keyword with the time of its beginning in s since 1970, or nothing."""
        samples = received.payload
        if len(samples) % BYTES_PER_SAMPLE:
            raise MessageError(f"{len(samples)} bytes are not 16 bit samples")
        length = len(samples) // BYTES_PER_SAMPLE * 1_000_000_000 // RATE
        if self._end is not None and received.stamp - length - self._end > MAX_GAP_NS:
            self._spotter.restart()
        self._end = received.stamp  # a microphone delivers a chunk when it is full
        hit = self._spotter.feed(samples)
        if hit is None:
            return None
        return {"keyword": hit.keyword, "at": self._end / 1e9 - (self._spotter.fed - hit.start)}
