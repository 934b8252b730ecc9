"""The voice activity gate: cuts sound into utterances, so that silence costs next to nothing."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from pocketsphinx import Vad

from modules.speech.spectrum import RATE

FRAME = RATE * 30 // 1000
"""Samples that the detector judges at once: 30 ms, the longest that it takes."""

BYTES_PER_SAMPLE = 2

_MARGIN = 10 ** (6 / 20)
"""How much louder than the background a voice must be: 6 dB."""
_BACKGROUND = 133
"""Frames whose tenth percentile of loudness is the background: 4 s, longer than people speak without a pause."""
_BEFORE = 10
"""Frames without voice that an utterance begins and ends with: PocketSphinx and the network need some on both sides."""
_VOICED = 4
"""Frames with voice, of the last ten, that begin an utterance: shorter than any command, longer than most knocks."""


@dataclass(frozen=True, slots=True)
class Utterance:
    """A stretch with speech; `start` is in seconds of sound since the gate was made."""

    start: float
    samples: np.typing.NDArray[np.float64]

    @property
    def spoken(self) -> float:
        """Seconds of it without what came before and after the voice."""
        return (len(self.samples) - 2 * _BEFORE * FRAME) / RATE


class Gate:
    """Takes a stream of 16 bit samples at 16 kHz and gives the utterances that end in it.

    The detector is that of WebRTC, which comes with PocketSphinx: Gaussian mixtures of voice and noise that adapt.
    Alone it takes steady noise that is loud for voice; so what counts must also be louder than the background.
    """

    def __init__(self, longest: float = 2.4, overlap: float = 1.0) -> None:
        """Cut connected speech into pieces of `longest` s, since a command must not wait for its end.

        They share `overlap` s, so that each command is whole in one of them.
        """
        self._longest = round(longest * RATE / FRAME)
        self._overlap = round(overlap * RATE / FRAME)
        self._rest = b""
        self.fed = 0
        """Samples that were judged."""
        self.restart()

    def restart(self) -> None:
        """Forget what was heard, after a gap in the sound; time goes on."""
        self.fed += len(self._rest) // BYTES_PER_SAMPLE
        self._rest = b""
        self._vad = Vad(Vad.LOOSE, RATE, FRAME / RATE)
        self._loudness: deque[float] = deque(maxlen=_BACKGROUND)
        self._frames: deque[bytes] = deque(maxlen=_BEFORE)
        self._voiced: deque[bool] = deque(maxlen=_BEFORE)
        self._utterance: list[bytes] | None = None

    def feed(self, samples: bytes) -> list[Utterance]:
        """Take the next piece of sound, of any length."""
        sound = self._rest + samples
        size = FRAME * BYTES_PER_SAMPLE
        whole = len(sound) // size * size
        self._rest = sound[whole:]
        ended = (self._next(sound[start : start + size]) for start in range(0, whole, size))
        return [utterance for utterance in ended if utterance is not None]

    def _next(self, frame: bytes) -> Utterance | None:
        self.fed += FRAME
        self._voiced.append(self._is_voice(frame))
        if self._utterance is None:
            self._frames.append(frame)
            if sum(self._voiced) >= _VOICED:
                self._utterance = list(self._frames)
            return None
        self._utterance.append(frame)
        if not any(self._voiced):
            ended, self._utterance = self._utterance, None
            self._frames.extend(ended[-_BEFORE:])
        elif len(self._utterance) >= self._longest:
            ended = self._utterance
            self._utterance = ended[len(ended) - self._overlap :]
        else:
            return None
        samples = np.frombuffer(b"".join(ended), "<i2").astype(np.float64)
        return Utterance((self.fed - len(samples)) / RATE, samples)

    def _is_voice(self, frame: bytes) -> bool:
        loudness = float(np.sqrt(np.mean(np.frombuffer(frame, "<i2").astype(np.float32) ** 2)))
        self._loudness.append(loudness)
        background = float(np.percentile(self._loudness, 10))
        return self._vad.is_speech(frame) and loudness > _MARGIN * background
