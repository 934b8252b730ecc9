"""What the networks see: bands and phones of a second, whatever the loudness, and nothing beyond the ends."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.phones import PhoneModel
from modules.speech.spectrum import BANDS, RATE
from modules.speech.windows import COLUMNS_PER_SECOND, SEEN, WIDTH, centred, columns, stretches


def sound(seconds=1.0):
    return np.random.default_rng(1).normal(0, 300, round(seconds * RATE))


def test_a_second_has_fifty_columns_and_loudness_does_not_matter():
    model = PhoneModel()
    seen = columns(sound(), model)
    assert len(seen) == pytest.approx(COLUMNS_PER_SECOND, abs=1)
    assert columns(sound() * 8, model) == pytest.approx(seen, abs=0.01)


@pytest.mark.parametrize("samples", [np.zeros(0), np.zeros(100), np.zeros(RATE)])
def test_silence_and_short_sound_give_finite_columns(samples):
    seen = columns(samples, PhoneModel())
    assert seen.shape[1] == SEEN
    assert np.isfinite(seen).all()


def test_windows_are_padded_beyond_the_ends():
    seen = np.ones((10, SEEN), np.float32)
    first, last = stretches(seen, [0, 9])
    assert (first[:, :BANDS] == 1).all()
    assert np.flatnonzero(first[:, BANDS]).tolist() == [*range(WIDTH // 2, WIDTH // 2 + 10)]
    assert np.flatnonzero(last[:, BANDS]).tolist() == [*range(WIDTH // 2 - 9, WIDTH // 2 + 1)]
    assert (seen == 1).all()


def test_a_microphone_that_favours_a_band_looks_like_any_other():
    windows = np.random.default_rng(1).random((2, WIDTH, SEEN)).astype(np.float32)
    coloured = windows.copy()
    coloured[:, :, :BANDS] += np.arange(BANDS)
    assert centred(coloured) == pytest.approx(centred(windows), abs=1e-4)
