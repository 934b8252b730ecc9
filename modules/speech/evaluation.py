"""`python -m modules.speech.evaluation`: measure detected commands and false alarms.

--words FOLDER...      folders of clips, in folders named after words: how often commands are detected, and in others
--connected FOLDER...  speech without commands, or noise (files too): false alarms a minute
--part held-out        only the speakers and sources that no choice was based on; or --part tuning, those for
                       thresholds; or --part training, the others (parts.py has the rule)
--tune                 the threshold that detects nine of ten clips of each command, and its false alarms
--weights FILE         networks that training.py wrote there, with the thresholds of the shipped ones
--synthetic            the generated test set (other texts, sizes and rooms than those of the training)
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.keywords import KEYWORDS
from modules.speech.listener import THRESHOLDS, Announcer, Listener
from modules.speech.network import WEIGHTS, Committee, WeightsError
from modules.speech.parts import PARTS, belongs
from modules.speech.spectrum import RATE
from modules.speech.speech_commands import (
    NOISE,
    RecordingError,
    between_silences,
    check,
    chunks,
    clips,
    load,
    recordings,
)
from modules.speech.tuning import Evidence

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from modules.speech.spectrum import Samples
    from modules.speech.speech_commands import Clip

TEST_SEED = 1000


@dataclass
class Score:
    """Clips of commands that were heard, of how many; what was taken for another; what was heard in other sound."""

    said: Counter[str] = field(default_factory=Counter)
    heard: Counter[str] = field(default_factory=Counter)
    confused: Counter[str] = field(default_factory=Counter)
    invented: Counter[str] = field(default_factory=Counter)
    seconds: float = 0

    def count(self, truth: str | None, announced: Sequence[str], seconds: float) -> None:
        """Count what was announced for a recording whose word is known, or that holds none."""
        wrong = Counter(f"{truth or 'sound'} as {keyword}" for keyword in announced if keyword != truth)
        if truth in KEYWORDS:
            self.said[truth] += 1
            self.heard[truth] += truth in announced
            self.confused += wrong
        else:
            self.seconds += seconds
            self.invented += wrong

    def add(self, other: Score) -> None:
        """Count what another score counted, too."""
        self.said += other.said
        self.heard.update(other.heard)
        self.confused += other.confused
        self.invented += other.invented
        self.seconds += other.seconds

    def report(self) -> str:
        """A line each: recall by command, confusions, false alarms."""
        lines = [
            f"{keyword}: {self.heard[keyword]} of {said} ({self.heard[keyword] / said:.0%})"
            for keyword, said in sorted(self.said.items())
        ]
        if self.said:
            lines += [f"taken for another command: {self.confused.total()}", *_counted(self.confused)]
        if self.seconds:
            count, minutes = self.invented.total(), self.seconds / 60
            rate = f"{count} in {minutes:.1f} minutes, {count / minutes:.2f} a minute"
            lines += [f"invented: {rate}", *_counted(self.invented)]
        return "\n".join(lines)


def _counted(found: Counter[str]) -> list[str]:
    return [f"  {what}: {count}" for what, count in found.most_common()]


class _Ear:
    """Listens to recordings, each by itself, and keeps the score, and the evidence for all that might be a command."""

    def __init__(self, committee: Committee) -> None:
        self.score = Score()
        self.evidence = Evidence()
        self._listener = Listener(committee)
        self._announcer = Announcer(THRESHOLDS)

    def hear(self, truth: str | None, samples: Samples) -> None:
        gate = self._listener.gate
        gate.restart()
        utterances = [utterance for chunk in chunks(samples) for utterance in gate.feed(chunk)]
        candidates = [self._listener.candidates(utterance) for utterance in utterances]
        announced = [heard.keyword for found in candidates for heard in self._announcer.announce(found)]
        self.score.count(truth, announced, len(samples) / RATE)
        self.evidence.count(truth, [heard for found in candidates for heard in found], len(samples) / RATE)


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


def judge(sounds: Iterable[tuple[str | None, Samples]], committee: Committee) -> _Ear:
    """Listen to all of them."""
    ear = _Ear(committee)
    for truth, samples in sounds:
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
    parser.add_argument("--words", type=Path, nargs="+", default=[])
    parser.add_argument("--split", help="training, validation or testing; all by default")
    parser.add_argument("--connected", type=Path, nargs="+", default=[])
    parser.add_argument("--part", choices=PARTS, help="of the speakers and sources; all by default")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--synthetic", action="store_true")
    parser.add_argument("--scale", type=float, default=0.1, help="how much to synthesise")
    options = parser.parse_args()
    try:
        committee = Committee.load(options.weights)
        sets = list(_sets(options))
        if options.tune:
            _print(judge(chain.from_iterable(sounds for _, sounds in sets), committee).evidence.report())
        else:
            _measure(sets, committee)
    except (RecordingError, WeightsError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _measure(sets: Sequence[tuple[str, Iterable[tuple[str | None, Samples]]]], committee: Committee) -> None:
    """Print the score of each set, and of all together."""
    total = Score()
    for name, sounds in sets:
        score = judge(sounds, committee).score
        _print(f"{name}\n{score.report()}")
        total.add(score)
    if len(sets) > 1:
        _print(f"all together\n{total.report()}")


def _sets(options: argparse.Namespace) -> Iterator[tuple[str, Iterable[tuple[str | None, Samples]]]]:
    wanted = options.part
    spoken = {
        folder: [clip for clip in clips(folder, options.split) if belongs(clip.path, folder, wanted)]
        for folder in options.words
    }
    sources = options.connected + [folder / NOISE for folder in options.words if (folder / NOISE).is_dir()]
    long = {source: [path for path in recordings(source) if belongs(path, source, wanted)] for source in sources}
    check(chain((clip.path for found in spoken.values() for clip in found), *long.values()))
    if not (any(spoken.values()) or any(long.values()) or options.synthetic):
        raise RecordingError(f"nothing to measure: no recordings of the part {wanted or 'all'}")
    for folder, found in spoken.items():
        if found:
            yield f"words of {folder}", words(found)
    for source, paths in long.items():
        if paths:
            yield f"connected speech or noise of {source}", connected(paths)
    if options.synthetic:
        yield "synthesised speech", synthetic(options.scale)


if __name__ == "__main__":
    sys.exit(main())
