"""Keyword spotting with PocketSphinx in one stretch of speech: a few commands, one model inside the package."""

from __future__ import annotations

import math
import os
import tempfile
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pocketsphinx import Decoder

from modules.speech.spectrum import FRAMES_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

    from modules.speech.spectrum import Samples

# Lower finds more and invents more. These find nearly all commands of real people, and in their other speech a wrong
# one every few seconds: the verifier decides.
KEYWORDS = {"forward": 1e-40, "backward": 1e-40, "left": 1e-22, "right": 1e-22, "stop": 1e-25}

_PEAK = 8000.0


@dataclass(frozen=True, slots=True)
class Mark:
    """A stretch that may hold a keyword, in seconds of the speech that was searched."""

    keyword: str
    start: float
    end: float
    score: float
    """How sure PocketSphinx is: a logarithm, at most 0, on a scale of its own."""


class Spotter:
    """Marks keywords in speech at 16 kHz, each stretch by itself, so that loudness and microphone cancel."""

    def __init__(self, keywords: Mapping[str, float] = KEYWORDS) -> None:
        self._decoder = _decoder(keywords)

    def spot(self, samples: Samples) -> list[Mark]:
        """All marks in the order of their beginning; the stretch should begin and end with some silence."""
        loudest = np.abs(samples).max(initial=0)
        if loudest == 0:
            return []
        self._decoder.start_utt()
        self._decoder.process_raw((samples * (_PEAK / loudest)).astype("<i2").tobytes(), full_utt=True)
        self._decoder.end_utt()
        marks = [
            Mark(
                segment.word.strip(),
                segment.start_frame / FRAMES_PER_SECOND,
                (segment.end_frame + 1) / FRAMES_PER_SECOND,
                math.log(segment.prob),
            )
            for segment in self._decoder.seg() or ()
        ]
        return sorted(marks, key=lambda mark: mark.start)


def _decoder(keywords: Mapping[str, float]) -> Decoder:
    with tempfile.NamedTemporaryFile("w", suffix=".kws") as file:
        file.writelines(f"{keyword} /{threshold:g}/\n" for keyword, threshold in keywords.items())
        file.flush()
        return Decoder(kws=os.fspath(file.name), lm=None, loglevel="FATAL")
