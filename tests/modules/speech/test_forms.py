"""Sound of other forms: converted when the encoding names it, and reported when only its rate shows it."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.forms import converter
from modules.speech.sound import SoundStream
from modules.speech.spectrum import RATE
from robotkit import MessageError, Received

TENTH_NS = 100_000_000
START = 1_700_000_000_000_000_000


class Recorder:
    """A gate that keeps what it is fed with."""

    def __init__(self):
        self.sound = b""

    def feed(self, samples):
        self.sound += samples
        return []

    def restart(self):
        pass


def tone(rate, hertz, seconds=1.0):
    return 8000 * np.sin(2 * np.pi * hertz * np.arange(round(rate * seconds)) / rate)


def stream(gate, samples, size, encoding="pcm-s16le-16khz-mono"):
    sound = SoundStream(gate)
    for index, start in enumerate(range(0, len(samples), size)):
        payload = samples[start : start + size].astype("<i2").tobytes()
        sound.feed(Received(payload, START + index * TENTH_NS, 0, "audio", encoding))


@pytest.mark.parametrize("khz", ["8", "22.05", "44.1", "48", "96"])
@pytest.mark.parametrize("channels", [1, 2])
def test_a_named_form_is_converted_without_seams(khz, channels):
    rate, gate = round(float(khz) * 1000), Recorder()
    samples = np.repeat(tone(rate, 1000), channels)
    form = f"pcm-s16le-{khz}khz-{'mono' if channels == 1 else 'stereo'}"
    stream(gate, samples, rate // 10 * channels, form)
    heard = np.frombuffer(gate.sound, "<i2")
    expected = tone(RATE, 1000)[: len(heard)]
    assert len(heard) == pytest.approx(RATE, abs=60)
    assert heard[100:] == pytest.approx(expected[100:], abs=80)


def test_frequencies_above_8_khz_are_filtered_out():
    down = converter("pcm-s16le-48khz-mono")
    assert down is not None
    loud = down.convert(tone(48_000, 11_000).astype("<i2").tobytes())
    assert np.abs(np.frombuffer(loud, "<i2")[100:]).max() < 80


@pytest.mark.parametrize(
    ("rate", "form"), [(44_100, "44.1 kHz mono"), (48_000, "48 kHz mono"), (88_200, "44.1 kHz stereo")]
)
def test_raw_sound_of_another_rate_is_refused_with_what_to_do(rate, form):
    with pytest.raises(MessageError, match=rf"{form}: expected 16 kHz, 16 bit, mono.*INPUT_AUDIO"):
        stream(Recorder(), tone(rate, 1000, 3), rate // 10)


def test_sound_of_16_khz_is_taken_as_it_is():
    gate, samples = Recorder(), tone(RATE, 1000, 5)
    stream(gate, samples, RATE // 10)
    assert gate.sound == samples.astype("<i2").tobytes()


@pytest.mark.parametrize("encoding", ["pcm-s16le-48khz-5.1", "opus", "pcm-s16le-4khz-mono", "pcm-f32le-16khz-mono"])
def test_an_unknown_encoding_is_named_with_what_is_expected(encoding):
    with pytest.raises(MessageError, match=f"invalid encoding '{encoding}': expected pcm-s16le-<rate>khz"):
        stream(Recorder(), tone(RATE, 1000), 1600, encoding)
