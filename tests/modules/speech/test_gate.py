"""Sound is cut into utterances, with their times, whatever the size of the pieces that it comes in."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from modules.speech.gate import Gate
from modules.speech.sound import SoundStream
from modules.speech.spectrum import RATE
from robotkit import Received

CHUNK = RATE // 10


def babble(seconds):
    """Harmonics of a voice at 120 Hz, in syllables: enough for the detector, and the same everywhere."""
    times = np.arange(round(seconds * RATE)) / RATE
    tone = sum(np.sin(2 * np.pi * 120 * n * times) / n for n in range(1, 25))
    return tone * 2000 * (0.6 + 0.4 * np.sin(2 * np.pi * 4 * times))


def sound(*parts):
    silence = np.random.default_rng(1)
    pieces = [silence.normal(0, 10, round(part * RATE)) if isinstance(part, float) else part for part in parts]
    return np.concatenate(pieces).astype("<i2").tobytes()


def cut(gate, samples, size=CHUNK):
    step = 2 * size
    return [one for start in range(0, len(samples), step) for one in gate.feed(samples[start : start + step])]


def test_an_utterance_has_its_time_and_silence_on_both_sides():
    (utterance,) = cut(Gate(), sound(2.0, babble(0.6), 1.0))
    assert 1.6 < utterance.start < 2.0
    assert 2.6 < utterance.start + len(utterance.samples) / RATE < 3.2


def test_an_utterance_reports_its_fraction_of_speech():
    (utterance,) = cut(Gate(), sound(1.0, babble(0.6), 1.0))
    assert utterance.spoken == pytest.approx(0.6, abs=0.2)


def test_silence_has_no_utterance():
    assert cut(Gate(), sound(5.0)) == []


def test_steady_noise_is_not_speech():
    hum = np.convolve(np.random.default_rng(2).normal(0, 3000, 10 * RATE), np.ones(8) / 4, "same")
    assert cut(Gate(), sound(hum)) == []


@pytest.mark.parametrize("size", [1, 137, 480, 16_000])
def test_the_size_of_the_pieces_does_not_matter(size):
    samples = sound(1.0, babble(0.5), 1.0)
    (expected,) = cut(Gate(), samples)
    (utterance,) = cut(Gate(), samples, size)
    assert utterance.start == expected.start
    assert np.array_equal(utterance.samples, expected.samples)


def test_connected_speech_comes_in_pieces_that_overlap():
    pieces = cut(Gate(longest=2.4, overlap=1.0), sound(1.0, babble(5), 1.0))
    assert len(pieces) >= 3
    ends = [piece.start + len(piece.samples) / RATE for piece in pieces]
    assert all(
        after.start == pytest.approx(end - 1.0, abs=0.03) for after, end in zip(pieces[1:], ends[:-1], strict=True)
    )
    assert ends[0] - pieces[0].start == pytest.approx(2.4, abs=0.03)


def test_without_overlap_no_sample_is_given_twice():
    pieces = cut(Gate(longest=2.0, overlap=0), sound(1.0, babble(5), 1.0))
    assert sum(len(piece.samples) for piece in pieces) / RATE < 6
    assert all(a.start + len(a.samples) / RATE <= b.start for a, b in pairwise(pieces))


def test_a_gap_starts_afresh_and_times_stay_right():
    stream = SoundStream(Gate())
    samples = sound(1.0, babble(0.5), 1.0)
    chunks = [samples[start : start + 2 * CHUNK] for start in range(0, len(samples), 2 * CHUNK)]
    reported = []
    for second in (100, 500):  # the same sound again, 400 s later
        for index, chunk in enumerate(chunks):
            end = second * 1_000_000_000 + (index + 1) * 100_000_000
            reported += [stream.time_of(one.start) for one in stream.feed(Received(chunk, end, 0))]
    assert reported == [pytest.approx(100.8, abs=0.2), pytest.approx(500.8, abs=0.2)]


def test_a_gap_discards_an_unfinished_utterance():
    stream = SoundStream(Gate())
    assert stream.feed(Received(sound(1.0, babble(0.5)), 10_000_000_000, 0)) == []
    assert stream.feed(Received(sound(1.0), 20_000_000_000, 0)) == []
