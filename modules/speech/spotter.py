"""Keyword spotting with PocketSphinx: a few commands, no network, one model inside the package."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pocketsphinx import Decoder

if TYPE_CHECKING:
    from collections.abc import Mapping

RATE = 16_000
BYTES_PER_SAMPLE = 2
FRAMES_PER_SECOND = 100
# Lower finds more and invents more; measured with five voices and noise, see README.md.
KEYWORDS = {"forward": 1e-8, "backward": 1e-8, "left": 1e-8, "right": 1e-8, "stop": 1e-8}


@dataclass(frozen=True, slots=True)
class Hit:
    """A keyword; `start` is in seconds of the audio that was fed since the last restart."""

    keyword: str
    start: float


class Spotter:
    """Hears one keyword after the other in a stream of 16 kHz, 16 bit, mono samples."""

    def __init__(self, keywords: Mapping[str, float] = KEYWORDS) -> None:
        self._decoder = _decoder(keywords)
        self._fed = 0
        self._utterance_start = 0
        self._decoder.start_utt()

    @property
    def fed(self) -> float:
        """Seconds of audio since the last restart."""
        return self._fed / RATE

    def feed(self, samples: bytes) -> Hit | None:
        """Take the next piece of audio; a hit ends the utterance, so that the next one is heard afresh."""
        self._decoder.process_raw(samples)
        self._fed += len(samples) // BYTES_PER_SAMPLE
        hypothesis = self._decoder.hyp()
        if hypothesis is None:
            return None
        segment = next(iter(self._decoder.seg()))
        hit = Hit(segment.word.strip(), self._utterance_start / RATE + segment.start_frame / FRAMES_PER_SECOND)
        self._next_utterance()
        return hit

    def restart(self) -> None:
        """Forget what was heard, after a gap in the audio."""
        self._fed = 0
        self._next_utterance()

    def _next_utterance(self) -> None:
        self._decoder.end_utt()
        self._decoder.start_utt()
        self._utterance_start = self._fed


def _decoder(keywords: Mapping[str, float]) -> Decoder:
    with tempfile.NamedTemporaryFile("w", suffix=".kws") as file:
        file.writelines(f"{keyword} /{threshold:g}/\n" for keyword, threshold in keywords.items())
        file.flush()
        return Decoder(kws=os.fspath(file.name), lm=None, loglevel="FATAL")
