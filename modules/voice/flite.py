"""Text to sound with flite, a small program of Debian that includes its voices."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from robotkit import ConfigurationError, DeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

VOICES = ("slt", "rms", "awb", "kal", "kal16")
LONGEST = 500
"""Characters spoken of one text at most: half a minute."""
_PATIENCE_S = 30


class Flite:
    """One of flite's voices."""

    def __init__(self, voice: str = VOICES[0]) -> None:
        program = shutil.which("flite")
        if program is None:
            raise ConfigurationError("flite is missing: install Debian's package flite")
        if voice not in VOICES:
            raise ConfigurationError(f"VOICE: invalid value {voice!r}: expected {', '.join(VOICES)}")
        self._command = [program, "-voice", voice]

    def speak(self, text: str) -> bytes:
        """The text as a WAV file: 16 kHz (8 kHz for kal), 16 bit, mono."""
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, "speech.wav")
            _run([*self._command, "-t", text[:LONGEST], "-o", str(path)], b"")
            return path.read_bytes()


class Player:
    """A program that plays a WAV file from its standard input."""

    def __init__(self, command: Sequence[str]) -> None:
        if command and shutil.which(command[0]) is None:
            raise ConfigurationError(f"VOICE_PLAYER: program {command[0]!r} not found")
        self._command = list(command)

    def play(self, wav: bytes) -> None:
        """Play it to its end; without a program nothing happens."""
        if self._command:
            _run(self._command, wav)


def _run(command: list[str], sound: bytes) -> None:
    try:
        subprocess.run(command, input=sound, capture_output=True, timeout=_PATIENCE_S, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        output = getattr(error, "stderr", None) or b""
        raise DeviceError(f"{command[0]} failed: {output.decode(errors='replace').strip() or error}") from error
