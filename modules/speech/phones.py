"""Which phones sound, frame by frame: the Gaussians of PocketSphinx's model, which many people's speech trained.

The output hardly depends on the speaker, so a network trained on synthesised speech works for real people too.
The model is phonetically tied: each of 42 phones has one codebook of 128 Gaussians in each of three feature streams,
and each of its three states weighs them again.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pocketsphinx import get_model_path

from modules.speech.spectrum import CEPSTRA, mel_cepstra, with_slopes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from modules.speech.spectrum import Samples

    Array = NDArray[np.float32]

PHONES, STREAMS, GAUSSIANS, STATES = 42, 3, 128, 3

_BYTE_ORDER = 0x11223344
_SMALLEST_VARIANCE = 1e-4
_WEIGHT_STEP = 1024 * np.log(1.0001)  # a step of the 8 bit weights, as a natural logarithm
_LEAST = np.float32(-60)


class PhoneModel:
    """The en-us model inside the package `pocketsphinx`."""

    def __init__(self, folder: Path | None = None) -> None:
        folder = folder or Path(get_model_path()) / "en-us/en-us"
        means, variances = _codebooks(folder / "means"), _codebooks(folder / "variances")
        variances = np.maximum(variances, _SMALLEST_VARIANCE)
        # log N(x) = x*x . a + x . b + c for all Gaussians of a stream at once.
        self._squares = (-0.5 / variances).reshape(STREAMS, -1, CEPSTRA).astype(np.float32)
        self._values = (means / variances).reshape(STREAMS, -1, CEPSTRA).astype(np.float32)
        constant = -0.5 * (means**2 / variances + np.log(2 * np.pi * variances)).sum(axis=-1)
        self._constant = constant.reshape(STREAMS, -1).astype(np.float32)
        self._weights = _weights(folder / "sendump")

    def posteriors(self, samples: Samples) -> Array:
        """How likely each phone is in each frame of 10 ms: shape (frames, 42), each row sums to 1."""
        features = with_slopes(mel_cepstra(samples)).astype(np.float32)
        scores = sum(self._scores(features[:, stream], stream) for stream in range(STREAMS))
        likely = np.exp(scores - np.max(scores, axis=(1, 2), keepdims=True)).sum(axis=2)
        posteriors: Array = likely / likely.sum(axis=1, keepdims=True)
        return posteriors

    def _scores(self, values: Array, stream: int) -> Array:
        """Log-likelihood of each phone's states, up to a constant for each frame: (frames, 42, 3)."""
        gaussians = values**2 @ self._squares[stream].T + values @ self._values[stream].T + self._constant[stream]
        gaussians = gaussians.reshape(-1, PHONES, GAUSSIANS)
        largest = gaussians.max(axis=(1, 2), keepdims=True, initial=-np.inf)
        likely = np.exp(np.maximum(gaussians - largest, _LEAST)).transpose(1, 0, 2)
        scores: Array = np.log(likely @ self._weights[stream]).transpose(1, 0, 2)
        return scores


def _codebooks(path: Path) -> NDArray[np.float64]:
    """Read `means` or `variances` (Sphinx 3 format) in the order (streams, phones, Gaussians, values)."""
    _, _, body = path.read_bytes().partition(b"endhdr\n")
    order, *shape = struct.unpack_from("<4I", body)
    if order != _BYTE_ORDER or shape != [PHONES, STREAMS, GAUSSIANS]:
        raise ValueError(f"{path}: not a phonetically tied model of {PHONES} phones: {shape}")
    values = np.frombuffer(body, "<f4", PHONES * STREAMS * GAUSSIANS * CEPSTRA, offset=20 + 4 * STREAMS)
    return values.astype(np.float64).reshape(PHONES, STREAMS, GAUSSIANS, CEPSTRA).swapaxes(0, 1)


def _weights(path: Path) -> Array:
    """Read the weights of the context-independent states, which come first: (streams, phones, Gaussians, states)."""
    content = path.read_bytes()
    position = 0
    while length := struct.unpack_from("<i", content, position)[0]:
        position += 4 + length
    rows, columns = struct.unpack_from("<2i", content, position + 4)
    if rows != GAUSSIANS:
        raise ValueError(f"{path}: {rows} Gaussians instead of {GAUSSIANS}")
    steps = np.frombuffer(content, np.uint8, STREAMS * rows * columns, offset=position + 12)
    steps = steps.reshape(STREAMS, rows, columns)[:, :, : PHONES * STATES].reshape(STREAMS, rows, PHONES, STATES)
    weights: Array = np.exp(-_WEIGHT_STEP * steps).transpose(0, 2, 1, 3).astype(np.float32)
    return weights
