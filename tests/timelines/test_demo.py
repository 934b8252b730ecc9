"""The demo's values and its recordings have the same story."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contextpolicy.streams.timeline import load
from timelines.datasets.euroc import Sequence
from timelines.datasets.recordings import RECORDINGS
from timelines.datasets.speech import Script

DEMO = load(Path(__file__).parents[2] / "timelines/demo.json")


def entries(key) -> list[Any]:
    """Their values and truths may be anything."""
    return [entry for entry in DEMO.entries if entry.key == key]


def test_the_imu_values_follow_the_recorded_motion():
    sequence = RECORDINGS["euroc"]
    assert isinstance(sequence, Sequence)
    for entry in entries("robot/imu"):
        times = np.linspace(entry.start, entry.end, 26)
        assert entry.value["speed"] == pytest.approx(sequence.motion.speed_at(times).mean(), abs=0.01)
        assert (np.linalg.norm(entry.value["gyro"]) > 0.02) == entry.truth["moving"]
        assert entry.truth["moving"] == (entry.value["speed"] > 0)


def test_the_spoken_words_are_those_of_the_script():
    (microphone,) = entries("robot/microphone")
    script = RECORDINGS[microphone.dataset]
    assert isinstance(script, Script)
    assert microphone.truth == [{"at": said.at, "keyword": said.keyword} for said in script.utterances]


def test_the_level_is_high_while_someone_speaks():
    levels, script = entries("robot/microphone/level"), RECORDINGS["speech/demo"]
    assert isinstance(script, Script)
    for entry in levels:
        assert (entry.value["level"] > 0.1) == entry.truth["speech"]
    for said in script.utterances:
        assert any(entry.start <= said.at < entry.end and entry.truth["speech"] for entry in levels)


def test_every_stream_lasts_the_whole_demo():
    for key in {entry.key for entry in DEMO.entries}:
        spans = [(entry.start, entry.end) for entry in DEMO.entries if entry.key == key]
        assert spans[0][0] == 0
        assert spans[-1][1] == DEMO.duration
        assert all(before[1] == after[0] for before, after in pairwise(spans))
