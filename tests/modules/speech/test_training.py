"""Training in the small: it learns what can be learned, and its whole way works on a handful of utterances."""

from __future__ import annotations

import sys
from collections import Counter
from functools import partial

import numpy as np
import pytest

from modules.speech import training
from modules.speech.confusable import holds_command
from modules.speech.corpus import FLITE_VOICES, Spoken, script, talk
from modules.speech.examples import CONTEXT, LABELS, Examples
from modules.speech.keywords import KEYWORDS
from modules.speech.network import Committee
from modules.speech.parts import PARTS, part
from modules.speech.spectrum import RATE
from modules.speech.synthesis import speak
from modules.speech.training import drawn, fit, importance, phrases
from modules.speech.windows import SEEN, WIDTH
from tests.modules.sounds import needs_voices, write


def examples(count):
    """A phone of its own sounds in the middle of each label."""
    rng = np.random.default_rng(1)
    labels = rng.integers(0, len(LABELS), count)
    seen = rng.random((count, CONTEXT, SEEN)).astype(np.float16) * 0.1
    seen[np.arange(count), CONTEXT // 2 - 5 : CONTEXT // 2 + 5, 30 + labels] = 1
    return Examples(seen, labels)


def test_a_network_learns_to_distinguish_labels():
    known = examples(256)
    network = fit(known, epochs=70)
    middle = slice((CONTEXT - WIDTH) // 2, (CONTEXT + WIDTH) // 2)
    predicted = network.log_probabilities(known.seen[:, middle].astype(np.float32)).argmax(axis=1)
    assert (predicted == known.labels).mean() > 0.95


def test_gradients_are_those_of_the_loss():
    rng = np.random.default_rng(1)
    known = examples(8)
    windows = drawn(known.seen, known.labels, rng)
    layers, weights = training._first(rng), importance(known.labels)
    lossless = pytest.MonkeyPatch()
    with lossless.context() as patch:
        patch.setattr(training, "_DROPOUT", {})
        patch.setattr(training, "_DECAY", 0)
        gradients = training._gradients(layers, windows, known.labels, weights, rng)
    for index, gradient in ((0, gradients[0]), (2, gradients[4]), (4, gradients[8])):
        place = np.unravel_index(np.abs(gradient).argmax(), gradient.shape)
        matrix = layers[index].matrix
        before = matrix[place]
        losses = []
        for change in (0.01, -0.01):
            matrix[place] = before + change
            losses.append(loss(layers, windows, known.labels, weights))
        matrix[place] = before
        assert (losses[0] - losses[1]) / 0.02 == pytest.approx(gradient[place], rel=0.05)


def loss(layers, windows, labels, weights):
    """The cross-entropy with smoothed labels."""
    values = windows
    for layer in layers[:-1]:
        values = np.maximum(layer(values), 0)
    scores = layers[-1](values)[:, 0].astype(float)
    logarithms = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
    smooth = training._SMOOTHING
    wanted = np.full(logarithms.shape, smooth / len(LABELS))
    wanted[np.arange(len(labels)), labels] += 1 - smooth
    return -(logarithms * wanted).sum(axis=1) @ weights / len(labels)


def test_phrases_place_each_command_beside_other_words():
    words = [Spoken(text, None, "rms", 1, 1) for text in ("seven", "bird", *KEYWORDS)]
    made = [*phrases(words, np.random.default_rng(1), 20)]
    taught = Counter(training._said(phrase.words[phrase.place]) for phrase in made)
    assert [taught[keyword] for keyword in KEYWORDS] == [20] * len(KEYWORDS)
    assert taught["seven"] + taught["bird"] == 50
    beside = {
        training._said(word) for phrase in made for place, word in enumerate(phrase.words) if place != phrase.place
    }
    assert beside == {"seven", "bird"}
    assert {(phrase.place, len(phrase.words)) for phrase in made} == {(1, 2), (0, 2), (1, 3), (2, 3)}


def test_no_phrase_is_made_of_commands_alone():
    assert not [*phrases([Spoken("left", "left", "rms", 1, 1)], np.random.default_rng(1), 5)]


def test_commands_weigh_as_much_as_the_rest_unless_few_speakers_recorded_them():
    labels = np.array([1, 1, 2, 2, 3, 3, 4, 4, 5, 5] + [0] * 30)
    weights = importance(labels)
    assert weights.sum() == pytest.approx(len(labels))
    assert weights[labels > 0].sum() == pytest.approx(weights[labels == 0].sum())
    rare = importance(np.array([1] + [0] * 99))
    assert rare[0] < 10 * rare[1]


@needs_voices
def test_the_command_trains_on_the_training_part_only(monkeypatch, tmp_path, capsys):
    speakers = {wanted: next(n for n in map(str, range(99)) if part(n) == wanted) for wanted in PARTS}
    write(tmp_path / f"words/left/{speakers['training']}_nohash_0.wav", speak("left", "rms"))
    write(tmp_path / f"words/stop/{speakers['held-out']}_nohash_0.wav", speak("stop", "rms"))
    write(tmp_path / f"words/right/{speakers['tuning']}_nohash_0.wav", speak("right", "rms"))
    write(tmp_path / f"talk/{speakers['training']}-1-0.wav", np.pad(speak("seven houses", "rms"), RATE))
    monkeypatch.setattr(training, "train", partial(training.train, epochs=1, committee=1))
    monkeypatch.setattr(training, "script", lambda _rng, _scale: [])
    folders = ["--words", tmp_path / "words", "--connected", tmp_path / "talk", "--scale", 0]
    monkeypatch.setattr(sys, "argv", ["training", *map(str, folders), "--output", str(tmp_path / "new.npz")])
    assert training.main() == 0
    said = capsys.readouterr().err
    assert "'left': 25" in said
    assert "'right': 0, 'stop': 0" in said
    assert Committee.load(tmp_path / "new.npz").labels == LABELS


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
