"""Writes spoken commands as 16 kHz audio with the time of every word: a script, several voices, background noise."""

from __future__ import annotations

import csv
import shutil
import subprocess
import tempfile
import wave
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

RATE = 16_000
PEAK = 0.4 * 32767
NOISE = 0.004 * 32767
_PATIENCE_S = 600
"""For a text that takes a tenth of a second: a busy machine may stand still for a minute."""
FLITE_VOICES = ("rms", "slt", "kal16")
FESTIVAL_VOICES = ("kal_diphone", "cmu_us_slt_arctic_hts")
VOICES = FLITE_VOICES + FESTIVAL_VOICES
ESPEAK = "espeak:"
"""Prefix of espeak-ng's voices, such as espeak:en-gb+f3; PocketSphinx hardly understands them."""
COMMANDS = {
    "forward": "go forward",
    "backward": "go backward",
    "left": "turn left",
    "right": "turn right",
    "stop": "stop now",
}


class SpeechError(Exception):
    """A speech synthesizer is missing or failed."""


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


def every_command(voices: tuple[str, ...] = VOICES, *, spacing: float = 1.8) -> Script:
    """Let each voice say each command once, one after the other."""
    said = [(keyword, voice) for voice in voices for keyword in COMMANDS]
    utterances = tuple(Utterance(0.5 + spacing * index, *words) for index, words in enumerate(said))
    return Script(0.5 + spacing * len(said), utterances)


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


def speak(text: str, voice: str, *, size: float = 1, tempo: float = 1) -> Samples:
    """Say a text; the loudest sample is PEAK for every voice.

    A `size` above 1 sounds like a smaller person: pitch and formants are higher. `tempo` is the speed of speech.
    """
    with tempfile.TemporaryDirectory() as scratch:
        raw, converted = Path(scratch, "raw.wav"), Path(scratch, "16k.wav")
        if voice.startswith(ESPEAK):
            _run(["espeak-ng", "-v", voice.removeprefix(ESPEAK), "-w", str(raw), text])
        elif voice in FESTIVAL_VOICES:
            _run(["text2wave", "-eval", f"(voice_{voice})", "-o", str(raw)], text)
        else:
            _run(["flite", "-voice", voice, "-t", text, "-o", str(raw)])
        effects = [] if size == tempo == 1 else ["speed", f"{size:g}", "tempo", "-s", f"{tempo / size:g}"]
        _run(["sox", "-G", str(raw), "-r", str(RATE), "-c", "1", "-b", "16", "-D", str(converted), *effects])
        with wave.open(str(converted)) as audio:
            samples = np.frombuffer(audio.readframes(audio.getnframes()), "<i2").astype(np.float64)
    loudest = float(np.abs(samples).max(initial=0))
    if loudest == 0:
        raise SpeechError(f"voice {voice} said nothing: install the packages flite, festival and its voices")
    louder: Samples = samples * (PEAK / loudest)
    return louder


def _run(command: list[str], text: str = "") -> None:
    program = shutil.which(command[0])
    if program is None:
        raise SpeechError(f"{command[0]} is missing: install the packages flite, festival, espeak-ng and sox")
    done = subprocess.run(
        [program, *command[1:]], input=text, capture_output=True, text=True, timeout=_PATIENCE_S, check=False
    )
    if done.returncode != 0:
        raise SpeechError(f"{' '.join(command)} failed: {done.stderr.strip()}")


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
