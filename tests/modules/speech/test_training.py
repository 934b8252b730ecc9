"""Training in the small: it learns what can be learned, and its whole way works on a handful of utterances."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from modules.speech.corpus import FLITE_VOICES, Spoken, in_a_room, script
from modules.speech.spectrum import RATE
from modules.speech.spotter import KEYWORDS
from modules.speech.training import LABELS, Examples, examine, fit, train
from modules.speech.verifier import INPUTS, Verifier

needs_voices = pytest.mark.skipif(
    shutil.which("flite") is None or shutil.which("sox") is None, reason="flite and sox are not installed"
)


def test_a_network_learns_what_tells_labels_apart():
    rng = np.random.default_rng(1)
    labels = rng.integers(0, len(LABELS), 600)
    seen = rng.random((600, INPUTS)).astype(np.float32) * 0.1
    seen[np.arange(600), labels * 50] = 5
    network = fit(seen, labels, epochs=30)
    assert (network.log_probabilities(seen).argmax(axis=1) == labels).mean() > 0.95


@needs_voices
def test_the_whole_way_from_texts_to_weights(tmp_path):
    texts = [Spoken(word, word, "rms", 1, 1) for word in KEYWORDS] + [Spoken("seven", None, "slt", 1.1, 0.9)]
    done = []
    examples = examine(texts, 1, done.append)
    assert done == [1, 2, 3, 4, 5, 6]
    counts = np.bincount(examples.labels, minlength=len(LABELS))
    assert counts[1:].tolist() == [6] * 5  # three rooms, two looks
    assert counts[0] >= 2
    train(Examples(examples.views, examples.labels), epochs=1).save(tmp_path / "weights.npz")
    assert Verifier.load(tmp_path / "weights.npz").labels == LABELS


def test_a_script_has_every_command_by_every_flite_voice_and_much_else():
    texts = list(script(np.random.default_rng(1), 1))
    assert {(one.keyword, one.voice) for one in texts} >= {(word, voice) for word in KEYWORDS for voice in FLITE_VOICES}
    assert sum(one.keyword is None for one in texts) > 1000
    assert not any(set(one.text.split()) & set(KEYWORDS) for one in texts if one.keyword is None)


def test_a_room_keeps_the_times():
    click = np.zeros(RATE)
    click[8000:8100] = 10_000
    for seed in range(5):
        heard = in_a_room(click, np.random.default_rng(seed))
        assert len(heard) == RATE
        assert abs(int(np.abs(heard).argmax()) - 8050) < 400
