"""`python -m modules.speech.evaluation`: how many commands are heard, and how many are invented.

--words FOLDER       Speech Commands' layout: how often each command is heard in its clips, and what in others
--connected FILE...  speech without commands, or noise: false alarms a minute
--synthetic          the generated test set (other texts, sizes and rooms than those of the training)
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.listener import Listener
from modules.speech.spectrum import RATE
from modules.speech.speech_commands import RecordingError, between_silences, chunks, clips, load, noises
from modules.speech.spotter import KEYWORDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from modules.speech.spectrum import Samples

TEST_SEED = 1000


@dataclass
class Score:
    """Clips of commands that were heard, of how many; and what was heard in sound without them."""

    said: Counter[str] = field(default_factory=Counter)
    heard: Counter[str] = field(default_factory=Counter)
    invented: Counter[str] = field(default_factory=Counter)
    seconds: float = 0

    def count(self, truth: str | None, told: Sequence[str], seconds: float) -> None:
        """Count what was told of a recording whose word is known, or that holds none."""
        if truth in KEYWORDS:
            self.said[truth] += 1
            self.heard[truth] += truth in told
        else:
            self.seconds += seconds
        self.invented.update(f"{truth or 'sound'} as {keyword}" for keyword in told if keyword != truth)

    def report(self) -> str:
        """A line each: recall by command, false alarms."""
        lines = [
            f"{keyword}: {self.heard[keyword]} of {said} ({self.heard[keyword] / said:.0%})"
            for keyword, said in sorted(self.said.items())
        ]
        count, minutes = self.invented.total(), self.seconds / 60
        rate = f", {count / minutes:.2f} a minute" if minutes else ""
        lines.append(f"invented: {count} in {minutes:.1f} minutes{rate}")
        return "\n".join([*lines, *(f"  {what}: {count}" for what, count in self.invented.most_common())])


class _Ear:
    """Listens to recordings, each by itself, and keeps the score."""

    def __init__(self) -> None:
        self.score = Score()
        self._listener = Listener()

    def hear(self, truth: str | None, samples: Samples) -> None:
        gate = self._listener.gate
        gate.restart()
        utterances = [utterance for chunk in chunks(samples) for utterance in gate.feed(chunk)]
        told = [heard.keyword for utterance in utterances for heard in self._listener.listen(utterance)]
        self.score.count(truth, told, len(samples) / RATE)


def words(folder: Path, split: str | None) -> Score:
    """Every clip, between silences."""
    ear = _Ear()
    for clip in clips(folder, split):
        ear.hear(clip.word, between_silences(load(clip.path)))
    return ear.score


def connected(paths: Iterable[Path]) -> Score:
    """Long recordings without commands."""
    ear = _Ear()
    for path in paths:
        ear.hear(None, load(path))
    return ear.score


def synthetic(scale: float) -> Score:
    """The training's texts by other people in other rooms."""
    from modules.speech.corpus import in_a_room, script  # noqa: PLC0415 - only this needs the programs that speak

    rng = np.random.default_rng(TEST_SEED)
    ear = _Ear()
    for spoken in script(rng, scale):
        sound = np.pad(spoken.samples(), RATE // 2)
        ear.hear(spoken.keyword, in_a_room(sound, rng))
    return ear.score


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> int:
    """Print the score of each set."""
    parser = argparse.ArgumentParser(
        prog="python -m modules.speech.evaluation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--words", type=Path)
    parser.add_argument("--split", help="training, validation or testing; all by default")
    parser.add_argument("--connected", type=Path, nargs="+", default=[])
    parser.add_argument("--synthetic", action="store_true")
    parser.add_argument("--scale", type=float, default=0.1, help="how much to synthesise")
    options = parser.parse_args()
    try:
        if options.words:
            _print(f"words of {options.words}\n{words(options.words, options.split).report()}")
            options.connected += noises(options.words)
        if options.connected:
            _print(f"connected speech and noise\n{connected(options.connected).report()}")
        if options.synthetic:
            _print(f"synthesised speech\n{synthetic(options.scale).report()}")
    except RecordingError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
