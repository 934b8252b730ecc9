"""The command that measures: its sets, halves and thresholds, and what it says of files that it can't use."""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest

from modules.speech import evaluation
from modules.speech.spectrum import RATE
from modules.speech.spotter import KEYWORDS
from modules.speech.synthesis import speak
from modules.speech.verifier import WEIGHTS
from tests.modules.sounds import needs_voices, write


def speaker(half):
    return next(name for name in map(str, range(100)) if evaluation.in_half(name, half))


def noise(seconds):
    return np.random.default_rng(1).normal(0, 100, round(seconds * RATE))


@pytest.fixture
def run(monkeypatch, capsys):
    def main(*arguments):
        monkeypatch.setattr(sys, "argv", ["evaluation", *map(str, arguments)])
        return evaluation.main(), capsys.readouterr()

    return main


@needs_voices
def test_words_and_connected_sound_of_one_half_are_scored_and_tuned_on(run, tmp_path):
    for half, word in (("tuning", "left"), ("rest", "forward")):
        write(tmp_path / f"words/{word}/{speaker(half)}_nohash_0.wav", speak(word, "rms"))
        write(tmp_path / f"{speaker(half)}-1.wav", noise(6))
    write(tmp_path / "words/_background_noise_/tap.wav", noise(6))
    of_half = ("--words", tmp_path / "words", "--connected", *tmp_path.glob("*.wav"), "--half", "rest")
    code, printed = run(*of_half)
    assert code == 0
    assert "forward: 1 of 1" in printed.out
    assert "left" not in printed.out
    assert "connected speech and noise\ninvented: 0 in" in printed.out
    code, printed = run(*of_half, "--tune")
    assert code == 0
    assert "forward: at -4.0 1 of 1 heard, 0.00 a minute invented" in printed.out
    assert len(printed.out.splitlines()) == 1 + len(KEYWORDS)


def test_all_that_is_no_recording_is_told_before_anything_is_heard(run, tmp_path):
    write(tmp_path / "words/left/1_nohash_0.wav", noise(1), rate=8_000)
    long = write(tmp_path / "long.wav", noise(1), rate=44_100)
    code, printed = run("--words", tmp_path / "words", "--connected", long, tmp_path / "none.wav", "--tune")
    assert code == 2
    assert printed.out == ""
    assert [line.partition(": ")[0].rpartition("/")[2] for line in printed.err.splitlines()] == [
        "1_nohash_0.wav",
        "long.wav",
        "none.wav",
    ]


def test_other_weights_are_measured_and_what_is_none_is_told(run, tmp_path):
    shutil.copy(WEIGHTS, tmp_path / "new.npz")
    sound = write(tmp_path / "sound.wav", noise(3))
    assert run("--connected", sound, "--weights", tmp_path / "new.npz")[0] == 0
    (tmp_path / "text.npz").write_text("hello")
    for name in ("text.npz", "missing.npz", "sound.wav"):
        code, printed = run("--connected", sound, "--weights", tmp_path / name)
        assert code == 2
        assert f"{name}: not weights that training wrote" in printed.err
