"""Which commands are heard, in speech whose truth is known; needs the voices of Debian's flite, and no network."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.gate import Gate
from modules.speech.keywords import KEYWORDS
from modules.speech.listener import THRESHOLDS, Announcer, Heard, Listener
from modules.speech.sound import SoundStream
from modules.speech.spectrum import RATE
from modules.speech.synthesis import FLITE_VOICES, speak
from modules.speech.task import Speech
from robotkit import MessageError, Received
from robotkit.accuracy import Event, match_events
from robotkit.ros import encode
from robotkit.ros_types import AUDIO, AUDIO_STAMPED
from tests.modules.sounds import needs_voices
from timelines.datasets import speech
from timelines.datasets.readers import read

CHUNK_NS = 100_000_000
START = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def script():
    return speech.every_command(FLITE_VOICES)


@pytest.fixture(scope="module")
def chunks(script, tmp_path_factory):
    root = tmp_path_factory.mktemp("datasets")
    (root / "speech/test").mkdir(parents=True)
    speech.write(root / "speech/test", script, progress=lambda _: None)
    return [payload for _, payload in read(root, "speech/test")]


def hear(task, chunks):
    received = (Received(chunk, START + (i + 1) * CHUNK_NS, 0) for i, chunk in enumerate(chunks))
    return [result.value for one in received for result in task.process(one)]


@needs_voices
def test_most_commands_are_heard_at_their_time_and_none_is_invented(script, chunks):
    reported = hear(Speech(Listener()), chunks)
    truth = [Event(utterance.at, utterance.keyword) for utterance in script.utterances]
    matched = match_events(
        truth, [Event(one["at"] - START / 1e9, one["keyword"]) for one in reported], early=0.3, late=1.2
    )
    assert matched.invented == 0
    assert matched.recall >= 0.8
    assert all(0.5 < one["confidence"] <= 1 for one in reported)


@pytest.mark.parametrize("loudness", [30, 1000])
def test_background_noise_is_not_a_command(loudness):
    noise = np.random.default_rng(1).normal(0, loudness, 10 * RATE).astype("<i2").tobytes()
    chunks = [noise[start : start + 3200] for start in range(0, len(noise), 3200)]
    assert hear(Speech(Listener()), chunks) == []


@needs_voices
def test_other_words_are_not_commands():
    for index, text in enumerate(("the family had long been settled in sussex", "my brother bought seven tickets")):
        said = np.pad(speak(text, "rms"), RATE // 2).astype("<i2").tobytes()
        chunks = [said[start : start + 3200] for start in range(0, len(said), 3200)]
        assert hear(Speech(Listener()), chunks) == [], index


@pytest.mark.parametrize("keyword", KEYWORDS)
def test_a_detection_below_even_odds_is_not_a_command(keyword):
    assert Announcer(THRESHOLDS).announce([Heard(keyword, 1.0, 1.5, -0.1)]) == []


def test_half_a_sample_is_refused():
    with pytest.raises(MessageError, match="16 bit"):
        Speech(Listener()).process(Received(b"abc", 0, 0))


class Recorder(Gate):
    """A gate that keeps what it is fed with."""

    def __init__(self):
        self.sound = b""

    def feed(self, samples):
        self.sound += samples
        return []


@pytest.mark.parametrize("type_name", [AUDIO, AUDIO_STAMPED])
def test_sound_from_ros_is_heard_as_any_other(type_name):
    gate = Recorder()
    fields = {"data": b"\x01\x02\x03\x04"} if type_name == AUDIO else {"audio": {"data": b"\x01\x02\x03\x04"}}
    payload = encode(fields, type_name, stamp=START)
    SoundStream(gate).feed(Received(payload, START, 0, "audio", "cdr", type_name))
    assert gate.sound == b"\x01\x02\x03\x04"


@pytest.fixture
def recorder():
    return Recorder()


def feed(gate, stamps_ms, size=3200):
    stream = SoundStream(gate)
    for number, stamp in enumerate(stamps_ms):
        stream.feed(Received(bytes([number + 1]) * size, START + stamp * 1_000_000, 0))
    return stream


def test_lost_chunks_are_concealed_by_the_one_before_them(recorder):
    stream = feed(recorder, [100, 200, 500])
    assert recorder.sound == b"\x01" * 3200 + b"\x02" * 9600 + b"\x03" * 3200
    assert stream.time_of(0.45) == pytest.approx(START / 1e9 + 0.45)


@pytest.mark.parametrize("late", [[160, 200, 300], [100, 270, 300], [100, 200, 340]])
def test_a_chunk_that_is_late_is_no_lost_one(late, recorder):
    feed(recorder, late)
    assert recorder.sound == b"\x01" * 3200 + b"\x02" * 3200 + b"\x03" * 3200


def test_short_chunks_may_be_late_by_more_than_they_last(recorder):
    feed(recorder, [10, 50, 60], size=320)
    assert recorder.sound == b"\x01" * 320 + b"\x02" * 320 + b"\x03" * 320


def test_an_empty_chunk_does_no_harm(recorder):
    feed(recorder, [100, 400], size=0)
    assert recorder.sound == b""


@needs_voices
@pytest.mark.parametrize("lost", [3, 11, 40])
def test_commands_after_a_lost_chunk_are_heard_as_if_it_had_come(chunks, lost):
    every = hear(Speech(Listener()), chunks)
    received = [Received(chunk, START + (i + 1) * CHUNK_NS, 0) for i, chunk in enumerate(chunks)]
    task = Speech(Listener())
    heard = [result.value for i, one in enumerate(received) if i != lost for result in task.process(one)]
    after = START / 1e9 + (lost + 1) / 10 + 3
    assert later(heard, after) == later(every, after)


def later(heard, after):
    return [(one["keyword"], round(one["at"], 1)) for one in heard if one["at"] > after]
