"""Which commands are heard, in speech whose truth is known; needs the voices of Debian's flite, and no network."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from modules.speech.spotter import RATE, Spotter
from modules.speech.task import Speech
from robotkit import MessageError, Received
from timelines.datasets import speech
from timelines.datasets.readers import read

CHUNK_NS = 100_000_000
needs_voices = pytest.mark.skipif(
    shutil.which("flite") is None or shutil.which("sox") is None, reason="flite and sox are not installed"
)


@pytest.fixture(scope="module")
def script():
    return speech.every_command(speech.FLITE_VOICES)


@pytest.fixture(scope="module")
def chunks(script, tmp_path_factory):
    root = tmp_path_factory.mktemp("datasets")
    (root / "speech/test").mkdir(parents=True)
    speech.write(root / "speech/test", script, progress=lambda _: None)
    return [payload for _, payload in read(root, "speech/test")]


@needs_voices
def test_most_commands_are_heard_at_their_time_and_none_is_invented(script, chunks):
    spotter = Spotter()
    hits = [hit for hit in map(spotter.feed, chunks) if hit is not None]
    said = {(round(hit.start - 0.3, 0), hit.keyword) for hit in hits}
    heard = [
        utterance
        for utterance in script.utterances
        if any(hit.keyword == utterance.keyword and -0.2 < hit.start - utterance.at < 1.2 for hit in hits)
    ]
    assert len(said) == len(hits) == len(heard)
    assert len(heard) >= 0.8 * len(script.utterances)


@needs_voices
def test_a_keyword_is_reported_with_its_wall_clock_time(script, chunks):
    start = 1_700_000_000_000_000_000
    process = Speech(Spotter()).process
    results = [process(Received(chunk, start + (i + 1) * CHUNK_NS, 0)) for i, chunk in enumerate(chunks[:20])]
    (heard,) = [result for result in results if result is not None]
    assert heard["keyword"] == "forward"
    assert 0 <= heard["at"] - start / 1e9 - script.utterances[0].at < 1


def test_background_noise_is_not_a_command():
    noise = np.random.default_rng(1).normal(0, 300, 10 * RATE).astype("<i2").tobytes()
    spotter = Spotter()
    assert not any(spotter.feed(noise[start : start + 3200]) for start in range(0, len(noise), 3200))


def test_a_gap_in_the_audio_starts_afresh():
    spotter = Spotter()
    task = Speech(spotter)
    silence = bytes(3200)
    task.process(Received(silence, CHUNK_NS, 0))
    task.process(Received(silence, 2 * CHUNK_NS, 0))
    assert spotter.fed == pytest.approx(0.2)
    task.process(Received(silence, 50 * CHUNK_NS, 0))
    assert spotter.fed == pytest.approx(0.1)


def test_half_a_sample_is_refused():
    with pytest.raises(MessageError, match="16 bit"):
        Speech(Spotter()).process(Received(b"abc", 0, 0))
