"""Phones from PocketSphinx's acoustic model; in speech of flite they are those of the word."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.phones import PHONES, PhoneModel
from modules.speech.spectrum import RATE, mel_cepstra, with_slopes
from modules.speech.synthesis import speak
from tests.modules.sounds import needs_voices

SILENCE, S, T, AA, AO = 32, 30, 33, 2, 5  # the order of the model's mdef file


@pytest.fixture(scope="module")
def model():
    return PhoneModel()


@needs_voices
def test_the_word_stop_is_its_phones(model):
    said = np.pad(speak("stop", "rms"), RATE // 4)
    said += np.random.default_rng(1).normal(0, 5, len(said))
    posteriors = model.posteriors(said)
    vowel = int(posteriors[:, [AA, AO]].sum(axis=1).argmax())
    before = posteriors[max(vowel - 25, 0) : vowel]
    assert before[:, S].max() > 0.2
    assert before[:, T].max() > 0.1
    assert posteriors[vowel, [AA, AO]].sum() > 0.5


def test_every_frame_sums_to_one(model):
    noise = np.random.default_rng(1).normal(0, 500, RATE)
    posteriors = model.posteriors(noise)
    assert posteriors.shape == (98, PHONES)
    assert posteriors.sum(axis=1) == pytest.approx(np.ones(98), abs=1e-5)


def test_loudness_does_not_matter(model):
    noise = np.random.default_rng(1).normal(0, 500, RATE)
    assert model.posteriors(noise * 8) == pytest.approx(model.posteriors(noise), abs=1e-2)


@pytest.mark.parametrize("length", [0, 1, 409, 410])
def test_the_shortest_sounds(model, length):
    assert model.posteriors(np.ones(length)).shape == (int(length == 410), PHONES)


def test_slopes_are_differences():
    ramp = np.repeat(np.arange(20.0)[:, None], 13, axis=1)
    features = with_slopes(ramp)
    assert features[10, 1] == pytest.approx(np.full(13, 4.0))
    assert features[10, 2] == pytest.approx(np.zeros(13))


def test_the_mean_of_the_cepstra_cancels():
    assert mel_cepstra(np.random.default_rng(1).normal(0, 500, RATE)).mean(axis=0) == pytest.approx(
        np.zeros(13), abs=1e-9
    )


def test_another_model_is_refused(tmp_path):
    (tmp_path / "means").write_bytes(b"s3\nendhdr\n" + np.array([0x11223344, 1, 1, 8], "<u4").tobytes())
    with pytest.raises(ValueError, match="not a phonetically tied model"):
        PhoneModel(tmp_path)
