"""What the networks are taught, and how often."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.corpus import Spoken
from modules.speech.examples import CONTEXT, LABELS, Phrase, at_speed, examine, extent, middle, within
from modules.speech.keywords import KEYWORDS
from modules.speech.spectrum import BANDS, RATE
from modules.speech.speech_commands import Clip
from modules.speech.synthesis import speak
from modules.speech.windows import SEEN
from tests.modules.sounds import needs_voices, write


def bell(at, seconds=1.0, pitch=0.3):
    """A tone of 0.2 s in faint noise; its pitch in radians per sample."""
    sound = np.random.default_rng(1).normal(0, 5, round(seconds * RATE))
    tone = np.arange(round((at - 0.1) * RATE), round((at + 0.1) * RATE))
    sound[tone] += 3000 * np.sin(tone * pitch)
    return sound


def loudest_band(seen):
    """Of the columns in the middle."""
    return int(seen[CONTEXT // 2 - 2 : CONTEXT // 2 + 2, :BANDS].mean(axis=0).argmax())


@pytest.mark.parametrize("at", [0.3, 0.5, 0.8])
def test_the_middle_of_a_word_is_found_in_its_clip(at):
    assert middle(bell(at)) == pytest.approx(at, abs=0.02)
    assert middle(at_speed(bell(at), 0.8)) == pytest.approx(at / 0.8, abs=0.03)


def test_rare_commands_are_augmented_and_other_words_used_once(tmp_path):
    clips = [Clip(write(tmp_path / f"{word}.wav", bell(0.5)), word) for word in ("left", "bird")]
    done: list[int] = []
    examples = examine(clips, 1, done.append)
    assert done == [2]
    assert np.bincount(examples.labels, minlength=len(LABELS)).tolist() == [1, 0, 0, 25, 0, 0]
    assert examples.seen.shape == (26, CONTEXT, SEEN)


@pytest.mark.parametrize(("place", "label"), [(0, 0), (1, LABELS.index("left")), (2, 0)])
def test_a_word_beside_others_is_in_the_middle_of_its_example(tmp_path, place, label):
    words = ("go", "left", "now")
    paths = [write(tmp_path / f"{word}.wav", bell(0.5, pitch=0.1 + 0.3 * index)) for index, word in enumerate(words)]
    phrase = Phrase(tuple(map(Clip, paths, words)), place)
    examples = examine([phrase], 1, lambda _: None)
    alone = examine([Clip(paths[place], words[place])], 1, lambda _: None)
    assert examples.labels.tolist() == [label]
    assert loudest_band(examples.seen[0]) == loudest_band(alone.seen[0])


@needs_voices
@pytest.mark.parametrize(("text", "beside"), [("turn left", 1), ("left now", -1)])
def test_the_command_of_a_synthesised_phrase_is_where_it_is_said(text, beside):
    phrase = Spoken(text, "left", "rms", 1, 1)
    examples = examine([phrase], 1, lambda _: None)
    assert examples.labels.tolist() == [LABELS.index("left")] * 2
    start, end = extent(phrase.samples())
    assert beside * (within(phrase)[1] - (start + end) / 2) > 0.1


@needs_voices
def test_connected_speech_and_noise_are_no_commands(tmp_path):
    talk = write(tmp_path / "talk.wav", np.pad(speak("the family had long been settled in sussex", "rms"), RATE))
    for sound in (talk, Spoken("the family had been settled", None, "slt", 1.1, 0.9), None):
        labels = examine([sound], 1, lambda _: None).labels
        assert len(labels) > 2
        assert not labels.any()


@needs_voices
def test_the_same_seed_gives_the_same_examples():
    texts = [Spoken(word, word, "rms", 1, 1) for word in KEYWORDS]
    once, again, other = (examine(texts, seed, lambda _: None) for seed in (1, 1, 2))
    assert np.array_equal(once.seen, again.seen)
    assert not np.array_equal(once.seen, other.seen)
    assert once.labels.tolist() == [1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
