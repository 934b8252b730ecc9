"""The word error rate, counted in the usual way."""

from __future__ import annotations

import numpy as np
import pytest

from modules.transcript.accuracy import Score, edits, judge, main, recorded
from tests.modules.sounds import write


class Parrot:
    """Hears the same in each utterance."""

    def transcribe(self, samples):
        del samples
        return "where were you"


@pytest.mark.parametrize(
    ("said", "expected", "count"),
    [
        ("where are you", "where are you", 0),
        ("where are you", "where were you", 1),
        ("where are you", "where you", 1),
        ("where are you", "oh where are you now", 2),
        ("", "what", 1),
        ("stop", "", 1),
    ],
)
def test_changed_missing_and_added_words_are_wrong(said, expected, count):
    assert edits(said.split(), expected.split()) == count


@pytest.fixture
def recording(tmp_path):
    """Loud noise in the middle of silence, which the gate takes for voice."""
    sound = np.zeros(2 * 16_000)
    sound[16_000:24_000] = np.random.default_rng(1).normal(0, 8_000, 8_000)
    return write(tmp_path / "a.wav", sound.clip(-32768, 32767))


def test_a_recording_is_judged_by_the_text_beside_it(recording):
    recording.with_suffix(".txt").write_text("Where are you\n")
    assert judge(recorded([recording]), Parrot()) == Score(words=3, wrong=1)
    assert Score(words=3, wrong=1).report() == "1 of 3 words wrong: 33%"


def test_a_recording_without_a_text_is_one_line(recording, capsys):
    assert main([str(recording)]) == 2
    assert "a.wav: the spoken text can't be read" in capsys.readouterr().err
