"""Which recordings are held out: by speaker where the name tells who speaks, else by source."""

from __future__ import annotations

from pathlib import Path

import pytest

from modules.speech.parts import PARTS, part, voice


def test_a_third_of_all_speakers_is_held_out():
    held_out = sum(part(f"{number:08x}") == "held-out" for number in range(3000))
    assert 900 < held_out < 1100
    assert {part(str(number)) for number in range(100)} == set(PARTS)


def test_the_rule_is_the_crc_32_of_the_name():
    names = ("123456789", "jarvis", "alexa", "club")
    assert [part(name) for name in names] == ["training", "held-out", "training", "tuning"]


@pytest.mark.parametrize(
    ("name", "whose"),
    [
        ("left/0a7c2a8d_nohash_0.wav", "0a7c2a8d"),
        ("103-1240-0000.wav", "103"),
        ("left/left17.wav", "club"),
        ("36c31f61-8330-451e-af7b-54866ef66339.wav", "club"),
    ],
)
def test_a_recording_belongs_to_its_speaker_or_to_its_source(name, whose):
    assert voice(Path(name), "club") == whose
