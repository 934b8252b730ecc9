"""Writes spoken commands as 16 kHz audio with the time of every word: a script, several voices, background noise."""

from __future__ import annotations

import csv
import wave
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.spectrum import RATE
from modules.speech.synthesis import VOICES, speak

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from modules.speech.spectrum import Samples

NOISE = 0.004 * 32767
SPACING = 1.8
"""Seconds from one command to the next."""
COMMANDS = {
    "forward": "go forward",
    "backward": "go backward",
    "left": "turn left",
    "right": "turn right",
    "stop": "stop now",
}


@dataclass(frozen=True)
class Utterance:
    """At `at` seconds, a voice says the command that contains the keyword."""

    at: float
    keyword: str
    voice: str


@dataclass(frozen=True)
class Script:
    """What is said when."""

    duration: float
    utterances: tuple[Utterance, ...]
    seed: int = 7


def every_command(voices: tuple[str, ...] = VOICES) -> Script:
    """Let each voice say each command once, one after the other."""
    said = [(keyword, voice) for voice in voices for keyword in COMMANDS]
    utterances = tuple(Utterance(0.5 + SPACING * index, *words) for index, words in enumerate(said))
    return Script(0.5 + SPACING * len(said), utterances)


def write(folder: Path, script: Script, progress: Callable[[float], None]) -> None:
    """Write `audio.wav` and `truth.csv` (seconds, keyword, voice) into the folder."""
    rng = np.random.default_rng(script.seed)
    samples = rng.normal(0, NOISE, round(script.duration * RATE))
    for index, utterance in enumerate(script.utterances):
        spoken = speak(COMMANDS[utterance.keyword], utterance.voice)
        start = round(utterance.at * RATE)
        samples[start : start + len(spoken)] += spoken[: len(samples) - start]
        progress((index + 1) / len(script.utterances))
    _write_audio(folder / "audio.wav", samples)
    _write_truth(folder / "truth.csv", script)


def _write_audio(path: Path, samples: Samples) -> None:
    with wave.open(str(path), "wb") as audio:
        audio.setnchannels(1)
        audio.setsampwidth(2)
        audio.setframerate(RATE)
        audio.writeframes(np.clip(samples, -32768, 32767).astype("<i2").tobytes())


def _write_truth(path: Path, script: Script) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("#at [s]", "keyword", "voice"))
        writer.writerows((said.at, said.keyword, said.voice) for said in script.utterances)
