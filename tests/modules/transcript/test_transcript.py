"""Utterances become text; an engine whose model is missing says so at the start."""

from __future__ import annotations

import json
import shutil
import sys
import types
from typing import Any

import numpy as np
import pytest

from modules.speech.spectrum import RATE
from modules.speech.synthesis import speak
from modules.transcript.engines import PocketSphinx, SherpaOnnx, Vosk, engine
from modules.transcript.task import Transcript
from robotkit import ConfigurationError, Received

needs_voices = pytest.mark.skipif(
    shutil.which("flite") is None or shutil.which("sox") is None, reason="flite and sox are not installed"
)


def feed(task, samples):
    sound = samples.astype("<i2").tobytes()
    size = RATE // 5
    results = []
    for index in range(0, len(sound), size):
        end = 1_000 + (index + len(sound[index : index + size])) / 2 / RATE
        results += task.process(Received(sound[index : index + size], round(end * 1e9), 0))
    return [result.value for result in results]


@needs_voices
def test_a_question_is_understood_by_the_model_inside_pocketsphinx():
    samples = np.pad(speak("where are you", "rms"), RATE)
    (reported,) = feed(Transcript(PocketSphinx()), samples + np.random.default_rng(1).normal(0, 10, len(samples)))
    assert reported["text"] == "where are you"
    assert reported["final"] is True
    assert reported["at"] == pytest.approx(1_000.8, abs=0.4)


class Deaf:
    def transcribe(self, samples):
        del samples
        return ""


@needs_voices
def test_an_utterance_without_words_is_not_reported():
    assert feed(Transcript(Deaf()), np.pad(speak("hello", "rms"), RATE)) == []


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"STT_ENGINE": "siri"}, "invalid value 'siri': expected pocketsphinx, sherpa-onnx, vosk"),
        ({"STT_ENGINE": "vosk"}, "STT_MODEL: '' is not a folder: vosk needs its model"),
        ({"STT_ENGINE": "sherpa-onnx", "STT_MODEL": "/no/model"}, "'/no/model' is not a folder"),
        ({"STT_ENGINE": "sherpa-onnx", "STT_MODEL": "."}, r"has no \*encoder\*.onnx"),
        ({"STT_ENGINE": "vosk", "STT_MODEL": "."}, "has no am/final.mdl"),
    ],
)
def test_missing_parts_are_reported(tmp_path, monkeypatch, environment, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigurationError, match=message):
        engine(environment)


@pytest.fixture
def model(tmp_path):
    for name in ("encoder-1.onnx", "decoder-1.onnx", "joiner-1.onnx", "tokens.txt", "am/final.mdl"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize("name", ["sherpa-onnx", "vosk"])
def test_a_package_that_is_not_in_the_image_is_reported(model, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name.replace("-", "_"), None)
    with pytest.raises(ConfigurationError, match=f"--build-arg ENGINE={name}"):
        engine({"STT_ENGINE": name, "STT_MODEL": str(model)})


def test_sherpa_onnx_is_called_as_its_documentation_says(model, monkeypatch):
    calls: list[Any] = []

    class Stream:
        def accept_waveform(self, rate, samples):
            calls.append((rate, samples.dtype.name, len(samples), float(np.abs(samples).max())))

        def input_finished(self):
            calls.append("finished")

    class Recognizer:
        def __init__(self):
            self.left = 2

        @classmethod
        def from_transducer(cls, **options):
            calls.append({key: str(value).rpartition("/")[2] for key, value in options.items()})
            return cls()

        def create_stream(self):
            return Stream()

        def is_ready(self, _):
            self.left -= 1
            return self.left >= 0

        def decode_stream(self, _):
            calls.append("decode")

        def get_result(self, _):
            return " WHERE ARE YOU"

    monkeypatch.setitem(sys.modules, "sherpa_onnx", types.SimpleNamespace(OnlineRecognizer=Recognizer))
    assert SherpaOnnx(model).transcribe(np.full(RATE, 16384.0)) == "where are you"
    files = {"encoder": "encoder-1.onnx", "decoder": "decoder-1.onnx", "joiner": "joiner-1.onnx"}
    assert calls == [
        {"tokens": "tokens.txt", "num_threads": "1", **files},
        (RATE, "float32", RATE + RATE // 2, 0.5),
        "finished",
        "decode",
        "decode",
    ]


def test_vosk_gets_the_models_path_and_so_downloads_nothing(model, monkeypatch):
    class Recognizer:
        def __init__(self, loaded, rate):
            assert (loaded, rate) == (str(model), RATE)

        def AcceptWaveform(self, sound):  # noqa: N802 - vosk's name
            assert sound == b"\x01\x00" * 3

        def FinalResult(self):  # noqa: N802 - vosk's name
            return json.dumps({"text": "stop"})

    fake = types.SimpleNamespace(Model=lambda model_path: model_path, KaldiRecognizer=Recognizer)
    monkeypatch.setitem(sys.modules, "vosk", fake)
    assert Vosk(model).transcribe(np.ones(3)) == "stop"
