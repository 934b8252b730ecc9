"""Text to 16 kHz audio with Debian's voices: flite's, festival's and espeak-ng's."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import wave
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.spectrum import RATE

if TYPE_CHECKING:
    from modules.speech.spectrum import Samples

PEAK = 0.4 * 32767
_PATIENCE_S = 600
"""For a text that takes a tenth of a second: a busy machine may stand still for a minute."""
FLITE_VOICES = ("rms", "slt", "kal16")
FESTIVAL_VOICES = ("kal_diphone", "cmu_us_slt_arctic_hts")
VOICES = FLITE_VOICES + FESTIVAL_VOICES
ESPEAK = "espeak:"
"""Prefix of espeak-ng's voices, such as espeak:en-gb+f3; PocketSphinx hardly understands them."""


class SpeechError(Exception):
    """A speech synthesizer is missing or failed."""


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
        raise SpeechError(f"voice {voice} produced no sound: install the packages flite, festival and its voices")
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
