"""`python -m modules.speech.evaluation`: how many commands are heard, and how many are invented.

--words FOLDER       Speech Commands' layout: how often each command is heard in its clips, and what in others
--connected FILE...  speech without commands, or noise: false alarms a minute
--half tuning|rest   only the half of the speakers that the thresholds may be chosen on, or only the others; a connected
                     recording's speaker is its name up to the first hyphen, as in LibriSpeech
--tune               what each threshold would hear and invent, and which one keeps to the goal
--weights FILE       the networks that training.py wrote there, with the thresholds of the shipped ones
--synthetic          the generated test set (other texts, sizes and rooms than those of the training)
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections import Counter
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.listener import THRESHOLDS, Listener, Teller
from modules.speech.spectrum import RATE
from modules.speech.speech_commands import RecordingError, between_silences, check, chunks, clips, load, noises
from modules.speech.spotter import KEYWORDS
from modules.speech.tuning import Evidence
from modules.speech.verifier import WEIGHTS, Verifier, WeightsError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from modules.speech.spectrum import Samples
    from modules.speech.speech_commands import Clip

TEST_SEED = 1000
HALVES = ("tuning", "rest")


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
    """Listens to recordings, each by itself, and keeps the score, and the evidence for all that might be a command."""

    def __init__(self, verifier: Verifier) -> None:
        self.score = Score()
        self.evidence = Evidence()
        self._listener = Listener(verifier)
        self._teller = Teller(THRESHOLDS)

    def hear(self, truth: str | None, samples: Samples) -> None:
        gate = self._listener.gate
        gate.restart()
        utterances = [utterance for chunk in chunks(samples) for utterance in gate.feed(chunk)]
        candidates = [self._listener.candidates(utterance) for utterance in utterances]
        told = [heard.keyword for found in candidates for heard in self._teller.tell(found)]
        self.score.count(truth, told, len(samples) / RATE)
        self.evidence.count(truth, [heard for found in candidates for heard in found], len(samples) / RATE)


def in_half(speaker: str, half: str | None) -> bool:
    """Whether a speaker belongs to a half; without one all do."""
    return half is None or zlib.crc32(speaker.encode()) % len(HALVES) == HALVES.index(half)


def words(spoken: Iterable[Clip]) -> Iterator[tuple[str | None, Samples]]:
    """Every clip with its word, between silences."""
    return ((clip.word, between_silences(load(clip.path))) for clip in spoken)


def connected(paths: Iterable[Path]) -> Iterator[tuple[str | None, Samples]]:
    """Long recordings without commands."""
    return ((None, load(path)) for path in paths)


def synthetic(scale: float) -> Iterator[tuple[str | None, Samples]]:
    """The training's texts by other people in other rooms."""
    from modules.speech.corpus import script  # noqa: PLC0415 - only this needs the programs that speak
    from modules.speech.rooms import in_a_room  # noqa: PLC0415 - the same

    rng = np.random.default_rng(TEST_SEED)
    for spoken in script(rng, scale):
        yield spoken.keyword, in_a_room(np.pad(spoken.samples(), RATE // 2), rng)


def judge(recordings: Iterable[tuple[str | None, Samples]], verifier: Verifier) -> _Ear:
    """Listen to all of them."""
    ear = _Ear(verifier)
    for truth, samples in recordings:
        ear.hear(truth, samples)
    return ear


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
    parser.add_argument("--half", choices=HALVES, help="of the speakers; all by default")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--synthetic", action="store_true")
    parser.add_argument("--scale", type=float, default=0.1, help="how much to synthesise")
    options = parser.parse_args()
    try:
        verifier = Verifier.load(options.weights)
        sets = list(_sets(options))
        for name, recordings in () if options.tune else sets:
            _print(f"{name}\n{judge(recordings, verifier).score.report()}")
        if options.tune:
            _print(judge(chain.from_iterable(recordings for _, recordings in sets), verifier).evidence.report())
    except (RecordingError, WeightsError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _sets(options: argparse.Namespace) -> Iterator[tuple[str, Iterable[tuple[str | None, Samples]]]]:
    spoken = clips(options.words, options.split) if options.words else []
    long = options.connected + (noises(options.words) if options.words else [])
    spoken = [clip for clip in spoken if in_half(clip.speaker, options.half)]
    long = [path for path in long if in_half(path.stem.partition("-")[0], options.half)]
    check([*(clip.path for clip in spoken), *long])
    if spoken:
        yield f"words of {options.words}", words(spoken)
    if long:
        yield "connected speech and noise", connected(long)
    if options.synthetic:
        yield "synthesised speech", synthetic(options.scale)


if __name__ == "__main__":
    sys.exit(main())
