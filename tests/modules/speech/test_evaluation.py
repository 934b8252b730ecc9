"""The command that measures: its sets, parts and thresholds, and what it says of files that it can't use."""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest

from modules.speech import evaluation
from modules.speech.keywords import KEYWORDS
from modules.speech.network import WEIGHTS
from modules.speech.parts import PARTS, part
from modules.speech.spectrum import RATE
from modules.speech.synthesis import speak
from tests.modules.sounds import needs_voices, write


def speaker(wanted):
    return next(name for name in map(str, range(100)) if part(name) == wanted)


def noise(seconds):
    return np.random.default_rng(1).normal(0, 100, round(seconds * RATE))


@pytest.fixture
def run(monkeypatch, capsys):
    def main(*arguments):
        monkeypatch.setattr(sys, "argv", ["evaluation", *map(str, arguments)])
        return evaluation.main(), capsys.readouterr()

    return main


@needs_voices
def test_words_and_connected_sound_of_one_part_are_scored_and_tuned_on(run, tmp_path):
    for wanted, word in (("training", "left"), ("held-out", "forward")):
        write(tmp_path / f"words/{word}/{speaker(wanted)}_nohash_0.wav", speak(word, "rms"))
        write(tmp_path / f"libri/{word}/{speaker(wanted)}-1-0.wav", noise(6))
    write(tmp_path / "words/_background_noise_/tap.wav", noise(6))
    held_out = ("--words", tmp_path / "words", "--connected", tmp_path / "libri", "--part", "held-out")
    code, printed = run(*held_out)
    assert code == 0
    assert "forward: 1 of 1" in printed.out
    assert "left" not in printed.out
    together = ["forward: 1 of 1 (100%)", "taken for another command: 0", "invented: 0 in 0.1 minutes, 0.00 a minute"]
    assert printed.out.splitlines()[-4:] == ["all together", *together]
    code, printed = run(*held_out, "--tune")
    assert code == 0
    assert "1 of 1 heard, 0.00 a minute invented" in printed.out
    assert len(printed.out.splitlines()) == 1 + len(KEYWORDS)


@pytest.mark.parametrize("wanted", ["held-out", "training"])
def test_a_source_whose_speakers_are_unknown_is_in_one_part_as_a_whole(run, tmp_path, wanted):
    source = tmp_path / next(name for name in map(str, range(100)) if part(name) == wanted)
    for name in ("alexa/1.wav", "alexa/2.wav", "jarvis/1.wav"):
        write(source / name, noise(2))
    assert "in 0.1 minutes" in run("--connected", source, "--part", wanted)[1].out
    code, printed = run("--connected", source, "--part", next(one for one in PARTS if one != wanted))
    assert code == 2
    assert "nothing to measure" in printed.err


def test_a_folder_without_recordings_is_reported(run, tmp_path):
    code, printed = run("--connected", tmp_path)
    assert code == 2
    assert f"{tmp_path}: no recordings: expected .wav files" in printed.err


def test_files_that_are_not_recordings_are_reported_before_any_is_played(run, tmp_path):
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


def test_other_weights_are_measured_and_invalid_ones_reported(run, tmp_path):
    shutil.copy(WEIGHTS, tmp_path / "new.npz")
    sound = write(tmp_path / "sound.wav", noise(3))
    assert run("--connected", sound, "--weights", tmp_path / "new.npz")[0] == 0
    (tmp_path / "text.npz").write_text("hello")
    for name in ("text.npz", "missing.npz", "sound.wav"):
        code, printed = run("--connected", sound, "--weights", tmp_path / name)
        assert code == 2
        assert f"{name}: not weights that training wrote" in printed.err
