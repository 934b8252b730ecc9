"""Sound as mel cepstra with their slopes, as the acoustic model of PocketSphinx was trained on (its `feat.params`).

Davis and Mermelstein, "Comparison of Parametric Representations for Monosyllabic Word Recognition",
IEEE TASSP 28 (1980).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Samples = NDArray[np.float64]
    Cepstra = NDArray[np.float64]

RATE = 16_000
HOP = 160
FRAMES_PER_SECOND = RATE // HOP
CEPSTRA = 13
BANDS = 25

_WINDOW = 410  # 25.6 ms
_SPECTRUM = 512
_LOWEST_HZ, _HIGHEST_HZ = 130.0, 6800.0
_PREEMPHASIS = 0.97
_LIFTER = 22
_FLOOR = 1e-4


def log_bands(samples: Samples) -> NDArray[np.float64]:
    """How loud each band of the mel scale is, as a logarithm: (frames, 25), a frame each 10 ms.

    Samples are 16 bit values at 16 kHz. What is shorter than one window has no frame.
    """
    frames = (len(samples) - _WINDOW) // HOP + 1
    if frames < 1:
        return np.empty((0, BANDS))
    emphasized = np.append(samples[:1], samples[1:] - _PREEMPHASIS * samples[:-1])
    pieces = np.lib.stride_tricks.sliding_window_view(emphasized, _WINDOW)[::HOP]
    power = np.abs(np.fft.rfft(pieces * np.hamming(_WINDOW), _SPECTRUM)) ** 2
    bands: NDArray[np.float64] = np.log(power @ _MEL_BANK + _FLOOR)
    return bands


def mel_cepstra(samples: Samples) -> Cepstra:
    """Cepstra of shape (frames, 13); their mean is 0 over the whole stretch, so microphones cancel."""
    cepstra = log_bands(samples) @ _COSINES
    centred: Cepstra = cepstra - cepstra.mean(axis=0) if len(cepstra) else cepstra
    return centred


def with_slopes(cepstra: Cepstra) -> NDArray[np.float64]:
    """Cepstra, their slope over four frames, and its slope over two: shape (frames, 3, 13)."""
    if not len(cepstra):
        return np.empty((0, 3, CEPSTRA))
    padded = np.pad(cepstra, ((3, 3), (0, 0)), mode="edge")
    slope = padded[4:] - padded[:-4]
    return np.stack([cepstra, slope[1:-1], slope[2:] - slope[:-2]], axis=1)


def _mel_bank() -> NDArray[np.float64]:
    """Triangles of unit area on the mel scale, their corners on the spectrum's own frequencies: (257, 25)."""
    lowest, highest = (2595 * np.log10(1 + hertz / 700) for hertz in (_LOWEST_HZ, _HIGHEST_HZ))
    mels = np.linspace(lowest, highest, BANDS + 2)
    step = RATE / _SPECTRUM
    corners = np.round(700 * (10 ** (mels / 2595) - 1) / step) * step
    low, middle, high = corners[:-2], corners[1:-1], corners[2:]
    hertz = np.arange(_SPECTRUM // 2 + 1)[:, None] * step
    triangles = np.minimum((hertz - low) / (middle - low), (high - hertz) / (high - middle))
    bank: NDArray[np.float64] = np.maximum(triangles, 0) * 2 / (high - low)
    return bank


def _liftered_cosines() -> NDArray[np.float64]:
    """The orthonormal DCT-II, with the sine lifter that evens out the size of the cepstra: (25, 13)."""
    orders = np.arange(CEPSTRA)
    cosines = np.cos(np.pi * (np.arange(BANDS)[:, None] + 0.5) * orders / BANDS) * np.sqrt(2 / BANDS)
    cosines[:, 0] /= np.sqrt(2)
    lifted: NDArray[np.float64] = cosines * (1 + _LIFTER / 2 * np.sin(np.pi * orders / _LIFTER))
    return lifted


_MEL_BANK = _mel_bank()
_COSINES = _liftered_cosines()
