from __future__ import annotations

import math
import threading
import wave
from array import array

import pytest

from modules.microphone import sources
from modules.microphone.sources import CHUNK, CHUNK_NS, Device, Recorded
from modules.microphone.task import Microphone, level
from robotkit import DeviceError
from robotkit.euroc import DatasetError

TONE = array("h", [round(16384 * math.sin(2 * math.pi * 440 * n / 16000)) for n in range(CHUNK)]).tobytes()


def a_recording(path, *, rate=16000, width=2, channels=1, frames=TONE * 2 + TONE[:100]):
    with wave.open(str(path), "wb") as audio:
        audio.setparams((channels, width, rate, 0, "NONE", "not compressed"))
        audio.writeframes(frames)
    return path


class PortAudio:
    """What sounddevice looks like, with a device that gives two chunks."""

    PortAudioError = RuntimeError

    def __init__(self):
        self.open = False

    def RawInputStream(self, *, device, callback, **form):  # noqa: N802 - sounddevice's name
        assert form == {"samplerate": 16000, "blocksize": CHUNK, "channels": 1, "dtype": "int16"}
        if device == "missing":
            raise ValueError("No input device matching 'missing'")
        for _ in range(2):
            callback(TONE, CHUNK, None, None)
        return self

    def __enter__(self):
        self.open = True

    def __exit__(self, *_):
        self.open = False


@pytest.mark.parametrize(("chunk", "loud"), [(TONE, 0.3535), (bytes(3200), 0.0), (b"", 0.0), (b"\x00\x80" * 9, 1.0)])
def test_a_level_is_a_root_mean_square(chunk, loud):
    assert level(chunk) == pytest.approx(loud, abs=1e-4)


def test_a_recording_gives_whole_chunks_and_their_levels(tmp_path):
    a_recording(tmp_path / "audio.wav")
    results = list(Microphone(Recorded(tmp_path)).produce(threading.Event()))
    assert [result.output for result in results] == ["audio", "level"] * 2
    assert results[0].value == results[2].value == TONE
    assert results[1].value == {"level": round(level(TONE), 4)}
    assert results[0].stamp is not None
    assert results[2].stamp == results[0].stamp + CHUNK_NS


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"rate": 44100}, "44100 Hz, 16 bit, 1 channels: expected 16000 Hz, 16 bit, 1 channel"),
        ({"channels": 2}, "2 channels"),
        ({"width": 1}, "8 bit"),
    ],
)
def test_sound_of_another_form_is_refused(tmp_path, change, expected):
    with pytest.raises(DatasetError, match=expected):
        Recorded(a_recording(tmp_path / "x.wav", **change))


@pytest.mark.parametrize("content", [None, b"", b"RIFF", b"RIFF\x00\x00\x00\x00WAVE", b"noise" * 10])
def test_a_file_that_is_not_sound_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "x.wav").write_bytes(content)
    with pytest.raises(DatasetError, match=r"x\.wav: cannot be read"):
        Recorded(tmp_path / "x.wav")


def test_a_device_gives_chunks_until_it_is_silent(monkeypatch):
    monkeypatch.setattr(sources, "SILENT_S", 0.01)
    portaudio = PortAudio()
    chunks = Device("", portaudio).chunks(threading.Event())
    assert [next(chunks)[1] for _ in range(2)] == [TONE, TONE]
    assert portaudio.open
    with pytest.raises(DeviceError, match="delivers no sound"):
        next(chunks)
    assert not portaudio.open


def test_a_device_that_is_missing_is_named():
    with pytest.raises(DeviceError, match="microphone missing can't be opened"):
        list(Device("missing", PortAudio()).chunks(threading.Event()))


def test_a_full_queue_drops_the_oldest_chunk():
    device = Device("", PortAudio())
    for number in range(60):
        device._hear(bytes([number]), 1, None, None)
    assert device._chunks.get_nowait()[1] == bytes([10])
