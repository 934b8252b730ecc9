"""What the networks see of speech: 50 columns a second, each with the loudness of 25 bands and the phones that sound.

A second of it is a window. A band's mean over the window is taken away, so that loudness and microphone cancel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.speech.phones import PHONES
from modules.speech.spectrum import BANDS, FRAMES_PER_SECOND, log_bands

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from modules.speech.phones import PhoneModel
    from modules.speech.spectrum import Samples

    Array = NDArray[np.float32]

COLUMNS_PER_SECOND = FRAMES_PER_SECOND // 2
WIDTH = COLUMNS_PER_SECOND
"""Columns of a window."""
SEEN = BANDS + PHONES

_PEAK = 8000.0
_DITHER = 0.003
"""Loudness of the noise that is added, as a part of the peak: 50 dB below it. Digital silence, which no room has, would
spoil the mean that the cepstra are compared with."""
_BAND_UNIT = 3.0
"""By which logarithms of loudness are divided, so that they are about as large as the phones' square roots."""


def columns(samples: Samples, model: PhoneModel) -> Array:
    """All of an utterance, whatever its loudness: (columns, SEEN). The square root makes faint phones visible."""
    loudest = max(float(np.abs(samples).max(initial=0)), 1.0)
    even = samples * (_PEAK / loudest)
    even = even + np.random.default_rng(len(even)).normal(0, _DITHER * _PEAK, len(even))
    frames = np.hstack([log_bands(even) / _BAND_UNIT, np.sqrt(model.posteriors(even))])
    pairs = frames[: len(frames) // 2 * 2].reshape(-1, 2, SEEN)
    found: Array = pairs.mean(axis=1).astype(np.float32)
    return found


def stretches(seen: Array, middles: ArrayLike, width: int = WIDTH) -> Array:
    """Some columns around each of the middles: (middles, width, SEEN).

    Beyond the ends no phone sounds, and the bands are as loud as at the end.
    """
    wanted = np.asarray(middles)[:, None] + np.arange(width) - width // 2
    cut: Array = seen[np.clip(wanted, 0, len(seen) - 1)]
    cut[..., BANDS:] *= ((wanted >= 0) & (wanted < len(seen)))[..., None]
    return cut


def centred(windows: Array) -> Array:
    """Windows whose bands have a mean of 0 each."""
    bands = windows[..., :BANDS]
    found: Array = np.concatenate([bands - bands.mean(axis=1, keepdims=True), windows[..., BANDS:]], axis=2)
    return found
