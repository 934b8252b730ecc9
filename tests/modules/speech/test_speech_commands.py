"""The published layout of Speech Commands v2, and the score of what is heard in it."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.evaluation import Score
from modules.speech.speech_commands import RecordingError, between_silences, chunks, clips, load, recordings
from tests.modules.sounds import write

NAMES = {
    "left/0a7c2a8d_nohash_0.wav": "training",
    "left/0b40aa8e_nohash_0.wav": "testing",
    "bird/0b40aa8e_nohash_1.wav": "testing",
    "stop/012c8314_nohash_0.wav": "validation",
}


SOUND = np.arange(8_000)


@pytest.fixture
def folder(tmp_path):
    for name in NAMES:
        write(tmp_path / name, SOUND)
    write(tmp_path / "_background_noise_/running_tap.wav", SOUND)
    for split in ("validation", "testing"):
        lines = (name for name, where in NAMES.items() if where == split)
        (tmp_path / f"{split}_list.txt").write_text("\n".join(lines) + "\n")
    return tmp_path


@pytest.mark.parametrize("split", ["training", "validation", "testing"])
def test_splits_are_those_of_the_lists(folder, split):
    found = {f"{clip.word}/{clip.path.name}" for clip in clips(folder, split)}
    assert found == {name for name, where in NAMES.items() if where == split}


def test_noise_is_not_a_word(folder):
    assert {clip.word for clip in clips(folder)} == {"bird", "left", "stop"}
    assert [path.name for path in recordings(folder / "_background_noise_")] == ["running_tap.wav"]


def test_recordings_are_those_of_all_folders_below_one(folder):
    assert len(recordings(folder)) == 1 + len(NAMES)
    assert recordings(folder / "left/0a7c2a8d_nohash_0.wav") == [folder / "left/0a7c2a8d_nohash_0.wav"]


def test_a_missing_list_is_reported(folder):
    (folder / "testing_list.txt").unlink()
    assert len(clips(folder)) == 4
    with pytest.raises(RecordingError, match=r"testing_list.txt: needed"):
        clips(folder, "training")


def test_a_folder_without_recordings_and_a_wrong_split_are_reported(tmp_path, folder):
    with pytest.raises(RecordingError, match="no recordings"):
        clips(tmp_path / "left")
    with pytest.raises(RecordingError, match="invalid value 'test': expected training, validation, testing"):
        clips(folder, "test")


def test_a_file_that_is_not_a_recording_is_reported(tmp_path):
    write(tmp_path / "slow.wav", SOUND, rate=8_000)
    with pytest.raises(RecordingError, match="8000"):
        load(tmp_path / "slow.wav")
    (tmp_path / "text.wav").write_text("hello")
    with pytest.raises(RecordingError, match=r"text.wav: not a WAV file"):
        load(tmp_path / "text.wav")


def test_a_clip_is_heard_between_silences_in_chunks(folder):
    clip = load(folder / "left/0a7c2a8d_nohash_0.wav")
    sound = between_silences(clip)
    assert np.array_equal(sound[12_800:-12_800], clip)
    assert sum(map(len, chunks(sound))) == 2 * (len(sound) + 16_000)


def test_a_score_counts_hits_confusions_and_false_alarms():
    score, other = Score(), Score()
    score.count("left", ["left", "stop"], 60)
    other.count("right", [], 60)
    other.count("bird", ["left"], 120)
    score.add(other)
    assert score.report() == (
        "left: 1 of 1 (100%)\nright: 0 of 1 (0%)\ntaken for another command: 1\n  left as stop: 1\n"
        "invented: 1 in 2.0 minutes, 0.50 a minute\n  bird as left: 1"
    )


def test_sound_alone_has_no_recall_and_commands_alone_no_false_alarms():
    sound, command = Score(), Score()
    sound.count(None, [], 60)
    command.count("left", [], 60)
    assert sound.report() == "invented: 0 in 1.0 minutes, 0.00 a minute"
    assert command.report() == "left: 0 of 1 (0%)\ntaken for another command: 0"
