"""Engines that turn an utterance into text. None downloads anything: a missing model is an error at the start."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from pocketsphinx import Decoder

from modules.speech.spectrum import RATE
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from modules.speech.spectrum import Samples

_FULL_SCALE = 32768


class Engine(Protocol):
    """Understands speech at 16 kHz, an utterance at a time."""

    def transcribe(self, samples: Samples) -> str:
        """The words, in lower case; empty when there are none."""
        ...


class PocketSphinx:
    """The general English language model inside the package: far from the state of the art, but always there."""

    def __init__(self) -> None:
        self._decoder = Decoder(loglevel="FATAL")

    def transcribe(self, samples: Samples) -> str:
        """Decode the utterance by itself, so that loudness and microphone cancel."""
        self._decoder.start_utt()
        self._decoder.process_raw(_sound(samples), full_utt=True)
        self._decoder.end_utt()
        hypothesis = self._decoder.hyp()
        return "" if hypothesis is None else str(hypothesis.hypstr)


class SherpaOnnx:
    """A streaming transducer of sherpa-onnx: a folder with tokens.txt and the networks encoder, decoder and joiner."""

    def __init__(self, folder: Path) -> None:
        files = {part: _one(folder, f"*{part}*.onnx") for part in ("encoder", "decoder", "joiner")}
        tokens = _one(folder, "tokens.txt")
        recognizer = _package("sherpa_onnx", "sherpa-onnx").OnlineRecognizer
        self._recognizer = recognizer.from_transducer(tokens=tokens, num_threads=1, **files)

    def transcribe(self, samples: Samples) -> str:
        """Feed the utterance and the silence that flushes the last word."""
        stream = self._recognizer.create_stream()
        sound = np.pad(samples, (0, RATE // 2)).astype(np.float32) / _FULL_SCALE
        stream.accept_waveform(RATE, sound)
        stream.input_finished()
        while self._recognizer.is_ready(stream):
            self._recognizer.decode_stream(stream)
        return str(self._recognizer.get_result(stream)).strip().lower()


class Vosk:
    """A Kaldi model of vosk: a folder with am, conf and graph."""

    def __init__(self, folder: Path) -> None:
        _one(folder, "am/final.mdl")
        self._vosk = _package("vosk", "vosk")
        self._model = self._vosk.Model(model_path=str(folder))

    def transcribe(self, samples: Samples) -> str:
        """Decode the utterance by itself."""
        recognizer = self._vosk.KaldiRecognizer(self._model, RATE)
        recognizer.AcceptWaveform(_sound(samples))
        return str(json.loads(recognizer.FinalResult())["text"])


WITH_MODEL: dict[str, Callable[[Path], Engine]] = {"sherpa-onnx": SherpaOnnx, "vosk": Vosk}


def engine(environment: Mapping[str, str]) -> Engine:
    """The engine that STT_ENGINE names, with the model in STT_MODEL."""
    name = environment.get("STT_ENGINE") or "pocketsphinx"
    if name == "pocketsphinx":
        return PocketSphinx()
    if name not in WITH_MODEL:
        raise ConfigurationError(f"STT_ENGINE: invalid value {name!r}: expected pocketsphinx, {', '.join(WITH_MODEL)}")
    folder = Path(environment.get("STT_MODEL") or "")
    if not environment.get("STT_MODEL") or not folder.is_dir():
        raise ConfigurationError(
            f"STT_MODEL: {environment.get('STT_MODEL', '')!r} is not a folder: {name} needs its model mounted"
        )
    return WITH_MODEL[name](folder)


def _one(folder: Path, pattern: str) -> str:
    found = sorted(folder.glob(pattern))
    if not found:
        raise ConfigurationError(f"STT_MODEL: {folder} has no {pattern}")
    return str(found[0])


def _package(module: str, package: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ConfigurationError(
            f"STT_ENGINE: the package {package} is not in this image: build it with --build-arg ENGINE={package}"
        ) from error


def _sound(samples: Samples) -> bytes:
    return samples.astype("<i2").tobytes()
