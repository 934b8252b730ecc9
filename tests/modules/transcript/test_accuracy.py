"""How many words are wrong, counted as everybody counts them."""

from __future__ import annotations

import wave

import numpy as np
import pytest

from modules.transcript.accuracy import Score, edits, judge, main, recorded


class Parrot:
    """Hears the same in each utterance."""

    def transcribe(self, samples):
        del samples
        return "where were you"


@pytest.mark.parametrize(
    ("said", "told", "count"),
    [
        ("where are you", "where are you", 0),
        ("where are you", "where were you", 1),
        ("where are you", "where you", 1),
        ("where are you", "oh where are you now", 2),
        ("", "what", 1),
        ("stop", "", 1),
    ],
)
def test_changed_missing_and_added_words_are_wrong(said, told, count):
    assert edits(said.split(), told.split()) == count


def write(path, seconds=2):
    """Loud noise in the middle of silence, which the gate takes for voice."""
    sound = np.zeros(seconds * 16_000)
    sound[16_000:24_000] = np.random.default_rng(1).normal(0, 8_000, 8_000)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(16_000)
        file.writeframes(sound.clip(-32768, 32767).astype("<i2").tobytes())


def test_a_recording_is_judged_by_the_text_beside_it(tmp_path):
    write(tmp_path / "a.wav")
    (tmp_path / "a.txt").write_text("Where are you\n")
    assert judge(recorded([tmp_path / "a.wav"]), Parrot()) == Score(words=3, wrong=1)
    assert Score(words=3, wrong=1).report() == "1 of 3 words wrong: 33%"


def test_a_recording_without_a_text_is_one_line(tmp_path, capsys):
    write(tmp_path / "a.wav")
    assert main([str(tmp_path / "a.wav")]) == 2
    assert "a.wav: what is said is not known" in capsys.readouterr().err
