"""Training in the small: it learns what can be learned, and its whole way works on a handful of utterances."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.confusable import holds_command
from modules.speech.corpus import FLITE_VOICES, Spoken, script, talk
from modules.speech.examples import LABELS, examine
from modules.speech.spotter import KEYWORDS
from modules.speech.training import fit, importance, train
from modules.speech.verifier import INPUTS, Verifier
from tests.modules.sounds import needs_voices


def test_a_network_learns_what_tells_labels_apart():
    rng = np.random.default_rng(1)
    labels = rng.integers(0, len(LABELS), 600)
    seen = rng.random((600, INPUTS)).astype(np.float32) * 0.1
    seen[np.arange(600), labels * 50] = 5
    network = fit(seen, labels, np.ones(600, np.float32), epochs=30)
    assert (network.log_probabilities(seen).argmax(axis=1) == labels).mean() > 0.95


@needs_voices
def test_the_whole_way_from_texts_to_weights(tmp_path):
    texts = [Spoken(word, word, "rms", 1, 1) for word in KEYWORDS] + [Spoken("seven", None, "slt", 1.1, 0.9)]
    train(examine(texts, 1, lambda _: None), epochs=1, committee=2).save(tmp_path / "weights.npz")
    loaded = Verifier.load(tmp_path / "weights.npz")
    assert loaded.labels == LABELS
    assert [len(committee) for committee in loaded.committees] == [2, 2]


def test_commands_count_as_much_as_all_else_and_what_is_marked_counts_most():
    labels = np.array([1, 1, 2, 3, 4, 5, 0, 0, 0, 0])
    marked = np.array([True] * 7 + [False] * 3)
    weights = importance(labels, marked)
    assert weights.sum() == pytest.approx(len(labels))
    assert weights[labels > 0].sum() == pytest.approx(weights[labels == 0].sum())
    assert weights[:2].sum() == pytest.approx(weights[2])
    assert weights[6] == pytest.approx(9 * weights[7:].sum())


def test_a_script_has_every_command_by_every_flite_voice_and_much_else():
    texts = list(script(np.random.default_rng(1), 1))
    assert {(one.keyword, one.voice) for one in texts} >= {(word, voice) for word in KEYWORDS for voice in FLITE_VOICES}
    assert sum(one.keyword is None for one in texts) > 1000
    others = {word for one in texts if one.keyword is None for word in one.text.split()}
    assert not [word for word in others if holds_command(word)]


def test_talk_is_connected_and_holds_no_command():
    said = [text.split() for text in talk(np.random.default_rng(1), 50)]
    assert np.mean([len(words) for words in said]) > 6
    assert not any(holds_command(word) for words in said for word in words)
