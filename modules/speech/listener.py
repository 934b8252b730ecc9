"""From utterances to commands: networks look at each second of an utterance, and the strongest evidence counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.gate import Gate
from modules.speech.keywords import KEYWORDS
from modules.speech.network import Committee
from modules.speech.phones import PhoneModel
from modules.speech.windows import COLUMNS_PER_SECOND, columns, stretches

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from modules.speech.gate import Utterance

# The evidence (log-odds) that a command needs: the highest, in steps of 0.5, with which nine of ten clips of the tuning
# part's speakers are heard; those say forward and backward too seldom to choose by. None may be below 0, a confidence
# of 0.5.
THRESHOLDS = {"forward": 2.0, "backward": 2.0, "left": 1.5, "right": 2.5, "stop": 2.0}

_STEP = 2
"""Columns from one window to the next."""
_AGREEING = 3
"""Windows whose evidence is averaged: a command is seen for longer than a moment that sounds like one."""
_HALF_S = 0.25
"""About half of a command's length."""

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


class Announcer:
    """Announces commands with enough evidence, and none twice, although the pieces of connected speech overlap."""

    def __init__(self, thresholds: Mapping[str, float]) -> None:
        self._thresholds = thresholds
        self._last: dict[str, float] = {}

    def announce(self, candidates: Iterable[Heard]) -> list[Heard]:
        """Those of the candidates, in the order of time, that are commands and were not announced just before."""
        announced = []
        for heard in candidates:
            if heard.evidence >= self._thresholds[heard.keyword] and self._is_new(heard):
                self._last[heard.keyword] = heard.start
                announced.append(heard)
        return announced

    def _is_new(self, heard: Heard) -> bool:
        return heard.start - self._last.get(heard.keyword, -math.inf) >= _SAME


class Listener:
    """Hears commands in a stream of 16 bit samples at 16 kHz."""

    def __init__(self, committee: Committee | None = None) -> None:
        self.gate = Gate()
        self._phones = PhoneModel()
        self._committee = committee or Committee.load()
        self._announcer = Announcer(THRESHOLDS)

    def listen(self, utterance: Utterance) -> list[Heard]:
        """The commands in an utterance, but not those that the piece of speech before it held already."""
        return self._announcer.announce(self.candidates(utterance))

    def candidates(self, utterance: Utterance) -> list[Heard]:
        """The strongest evidence for each command, in the order of time."""
        seen = columns(utterance.samples, self._phones)
        middles = np.arange(0, len(seen), _STEP)
        if not len(middles):
            return []
        evidence = self._committee.evidence(stretches(seen, middles))
        found = [self._strongest(keyword, one, utterance) for keyword, one in zip(KEYWORDS, evidence.T, strict=True)]
        return sorted(found, key=lambda heard: heard.start)

    @staticmethod
    def _strongest(keyword: str, evidence: NDArray[np.float32], utterance: Utterance) -> Heard:
        lasting = np.convolve(evidence, np.full(_AGREEING, 1 / _AGREEING), "same")
        best = int(lasting.argmax())
        middle = utterance.start + best * _STEP / COLUMNS_PER_SECOND
        return Heard(keyword, middle - _HALF_S, middle + _HALF_S, float(lasting[best]))
