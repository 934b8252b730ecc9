"""`python -m modules.transcript.accuracy [FILE.wav ...]`: measure how many words the engine gets wrong.

Each recording (16 kHz, 16 bit, mono) needs its text beside it, in FILE.txt. Without recordings, flite's voices ask the
chatbot's questions and read sentences. The engine is chosen as in the module: STT_ENGINE, STT_MODEL.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.corpus import SENTENCES
from modules.speech.gate import Gate
from modules.speech.spectrum import RATE
from modules.speech.speech_commands import RecordingError, chunks, load
from modules.speech.synthesis import FLITE_VOICES, speak
from modules.transcript.engines import engine
from modules.transcript.task import LONGEST_S
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from modules.speech.spectrum import Samples
    from modules.transcript.engines import Engine

QUESTIONS = ("where are you", "what are you doing", "why did you stop listening", "how are you", "what can you do")
_NOISE = 10.0
_SENTENCES = 20


@dataclass
class Score:
    """Words that were said, and how many of them were changed, left out or added."""

    words: int = 0
    wrong: int = 0

    def count(self, said: Sequence[str], hypothesis: Sequence[str]) -> None:
        """Count one recording."""
        self.words += len(said)
        self.wrong += edits(said, hypothesis)

    def report(self) -> str:
        """The word error rate."""
        return f"{self.wrong} of {self.words} words wrong: {self.wrong / max(self.words, 1):.0%}"


def edits(said: Sequence[str], hypothesis: Sequence[str]) -> int:
    """The fewest words to change, leave out or add (Levenshtein 1966)."""
    before = list(range(len(hypothesis) + 1))
    for row, word in enumerate(said, 1):
        after = [row]
        for column, other in enumerate(hypothesis, 1):
            after.append(min(before[column] + 1, after[-1] + 1, before[column - 1] + (word != other)))
        before = after
    return before[-1]


def judge(recordings: Iterable[tuple[Samples, str]], ears: Engine) -> Score:
    """Feed each recording to the engine as the module does, an utterance at a time."""
    score = Score()
    for sound, text in recordings:
        gate = Gate(longest=LONGEST_S, overlap=0)
        utterances = [utterance for chunk in chunks(sound) for utterance in gate.feed(chunk)]
        hypothesis = [word for utterance in utterances for word in ears.transcribe(utterance.samples).split()]
        score.count(text.lower().split(), hypothesis)
    return score


def recorded(paths: Iterable[Path]) -> Iterator[tuple[Samples, str]]:
    """Each recording with the text beside it."""
    for path in paths:
        try:
            text = path.with_suffix(".txt").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{path}: the spoken text can't be read: {error}") from error
        yield load(path), text


def spoken(texts: Iterable[str]) -> Iterator[tuple[Samples, str]]:
    """Each text by one of flite's voices after the other, in a quiet room."""
    rng = np.random.default_rng(1)
    for index, text in enumerate(texts):
        sound = np.pad(speak(text, FLITE_VOICES[index % len(FLITE_VOICES)]), RATE)
        yield sound + rng.normal(0, _NOISE, len(sound)), text


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the word error rate; exit code 2 for what can't be read."""
    parser = argparse.ArgumentParser(
        prog="python -m modules.transcript.accuracy",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("recordings", type=Path, nargs="*", metavar="FILE.wav")
    options = parser.parse_args(arguments)
    sets = {"recordings": recorded(options.recordings)}
    if not options.recordings:
        sets = {"questions": spoken(QUESTIONS * len(FLITE_VOICES))}
        sets["sentences"] = spoken(SENTENCES.strip().splitlines()[:_SENTENCES])
    try:
        ears = engine(os.environ)
        for name, recordings in sets.items():
            sys.stdout.write(f"{name}: {judge(recordings, ears).report()}\n")
            sys.stdout.flush()
    except (ConfigurationError, RecordingError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
