"""From utterances to commands: the spotter marks what may be a command, the verifier decides."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.gate import Gate
from modules.speech.phones import PhoneModel
from modules.speech.spotter import Spotter
from modules.speech.verifier import Verifier

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from modules.speech.gate import Utterance
    from modules.speech.spectrum import Samples

# The evidence (log-odds) that a command needs: see README.md.
THRESHOLDS = {"forward": 2.0, "backward": -3.0, "left": -1.8, "right": -0.5, "stop": 0.0}

_ALONE, _AMONG = 0.5, 1.3
"""Seconds of speech beside a mark up to which it stands alone, and from which on it is one word among many."""
_DOUBT = 3.0
"""What a mark among many words loses: who gives an order says little else, and much that is said sounds like one."""

_DITHER = 0.003
"""Loudness of the noise that is added, as a part of the utterance's peak: 50 dB below it."""
_SAME = 0.5
"""Seconds within which a keyword is heard once: the pieces of connected speech overlap."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A command, in seconds of sound since the gate was made; `evidence` is the log-odds that it was said."""

    keyword: str
    start: float
    end: float
    evidence: float

    @property
    def confidence(self) -> float:
        """The evidence as a number from 0 to 1."""
        return 1 / (1 + math.exp(-self.evidence))


class Teller:
    """Tells what has enough evidence, and no command twice, though the pieces of connected speech overlap."""

    def __init__(self, thresholds: Mapping[str, float]) -> None:
        self._thresholds = thresholds
        self._last: dict[str, float] = {}

    def tell(self, candidates: Iterable[Heard]) -> list[Heard]:
        """Those of the candidates, in the order of time, that are commands and were not told just before."""
        told = []
        for heard in candidates:
            if heard.evidence >= self._thresholds[heard.keyword] and self._is_new(heard):
                self._last[heard.keyword] = heard.start
                told.append(heard)
        return told

    def _is_new(self, heard: Heard) -> bool:
        return heard.start - self._last.get(heard.keyword, -math.inf) >= _SAME


class Listener:
    """Hears commands in a stream of 16 bit samples at 16 kHz."""

    def __init__(self, verifier: Verifier | None = None) -> None:
        self.gate = Gate()
        self._spotter = Spotter()
        self._phones = PhoneModel()
        self._verifier = verifier or Verifier.load()
        self._teller = Teller(THRESHOLDS)

    def listen(self, utterance: Utterance) -> list[Heard]:
        """The commands in an utterance, but not those that the piece of speech before it held already."""
        return self._teller.tell(self.candidates(utterance))

    def candidates(self, utterance: Utterance) -> list[Heard]:
        """All that the spotter marks, in the order of time, with the evidence for it."""
        samples = _dithered(utterance.samples)
        marks = self._spotter.spot(samples)
        if not marks:
            return []
        posteriors = self._phones.posteriors(samples)
        begin = utterance.start
        return [
            Heard(
                mark.keyword,
                begin + mark.start,
                begin + mark.end,
                self._verifier.evidence(posteriors, mark) - doubt(utterance.spoken - (mark.end - mark.start)),
            )
            for mark in marks
        ]


def doubt(beside: float) -> float:
    """What so many seconds of speech beside a mark take from its evidence."""
    return _DOUBT * min(max((beside - _ALONE) / (_AMONG - _ALONE), 0.0), 1.0)


def _dithered(samples: Samples) -> Samples:
    """Add faint noise: digital silence, which no room has, would spoil the mean that the cepstra are compared with."""
    noise = np.random.default_rng(len(samples)).normal(0, _DITHER * np.abs(samples).max(initial=0), len(samples))
    dithered: Samples = samples + noise
    return dithered
