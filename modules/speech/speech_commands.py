"""Speech Commands v2 in its published layout (Warden, arXiv:1804.03209): `<word>/<speaker>_nohash_<n>.wav`, 1 s each.

`testing_list.txt` and `validation_list.txt` name the files of two splits, a line each; all others are for training.
`_background_noise_` has minutes of noise and no word.
"""

from __future__ import annotations

import wave
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.spectrum import RATE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from modules.speech.spectrum import Samples

SPLITS = ("training", "validation", "testing")
LISTS = {"validation": "validation_list.txt", "testing": "testing_list.txt"}
NOISE = "_background_noise_"
CHUNK = RATE // 10


class RecordingError(Exception):
    """A folder or a file that is not what its layout promises; the message names it."""


@dataclass(frozen=True, slots=True)
class Clip:
    """A recording of one word; clips of a speaker are in one split only."""

    path: Path
    word: str


def clips(folder: Path, split: str | None = None) -> list[Clip]:
    """The clips of a split, or all, in the order of their paths."""
    if split is not None and split not in SPLITS:
        raise RecordingError(f"split: invalid value {split!r}: expected {', '.join(SPLITS)}")
    found = [Clip(path, path.parent.name) for path in sorted(folder.glob("[!_.]*/*.wav"))]
    if not found:
        raise RecordingError(f"{folder}: no recordings in folders named after words")
    if split is None:
        return found
    lists = {name: _listed(folder, name) for name in LISTS}
    return [clip for clip in found if _split(f"{clip.word}/{clip.path.name}", lists) == split]


def recordings(source: Path) -> list[Path]:
    """All recordings in a folder and in those below it; a file is its own only one."""
    found = sorted(source.rglob("*.wav")) if source.is_dir() else [source]
    if not found:
        raise RecordingError(f"{source}: no recordings: expected .wav files")
    return found


def load(path: Path) -> Samples:
    """16 kHz, 16 bit, mono."""
    with _opened(path) as file:
        content = file.readframes(file.getnframes())
    return np.frombuffer(content[: len(content) // 2 * 2], "<i2").astype(np.float64)


def check(paths: Iterable[Path]) -> None:
    """Report everything that can't be loaded at once: listening takes hours, and one bad file would end it."""
    problems = []
    for path in paths:
        try:
            with _opened(path):
                pass
        except RecordingError as error:
            problems.append(str(error))
    if problems:
        raise RecordingError("\n".join(problems))


@contextmanager
def _opened(path: Path) -> Iterator[wave.Wave_read]:
    try:
        with wave.open(str(path)) as file:
            form = file.getframerate(), file.getsampwidth(), file.getnchannels()
            if form != (RATE, 2, 1):
                raise RecordingError(
                    f"{path}: unsupported format {form}: expected {RATE} Hz, 2 bytes per sample, 1 channel"
                )
            yield file
    except (OSError, EOFError, wave.Error) as error:
        raise RecordingError(f"{path}: not a WAV file: {error}") from error


def _listed(folder: Path, split: str) -> set[str]:
    path = folder / LISTS[split]
    try:
        return set(path.read_text(encoding="utf-8").split())
    except OSError as error:
        raise RecordingError(f"{path}: needed to tell the splits apart: {error}") from error


def _split(name: str, lists: dict[str, set[str]]) -> str:
    return next((split for split, names in lists.items() if name in names), "training")


_SILENCE_S = 0.8
"""Before and after a word."""


def between_silences(samples: Samples, seconds: float = _SILENCE_S) -> Samples:
    """A clip as a robot would hear it: the noise of its quietest part goes on before and after the word."""
    rng = np.random.default_rng(len(samples))
    level = max(float(np.percentile(np.abs(samples), 10)), 3) if len(samples) else 3.0
    before, after = (rng.normal(0, level, round(seconds * RATE)) for _ in range(2))
    return np.concatenate([before, samples, after])


def chunks(samples: Samples) -> Iterator[bytes]:
    """Sound as a microphone delivers it, with a second of silence at the end."""
    sound = np.concatenate([np.clip(samples, -32768, 32767), np.zeros(RATE)]).astype("<i2")
    for start in range(0, len(sound), CHUNK):
        yield sound[start : start + CHUNK].tobytes()
