"""`python -m modules.signs.accuracy`: measure how many numbers each of the two networks reads correctly.

FILE ...           SVHN's digitStruct.mat (format 1) or *_32x32.mat (format 2)
--rendered FOLDER  draws signs in fonts that no network was trained on, writes them in both formats, and reads them
--drives N         drives along signs and back N times: is each reported once each time it passes?
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import islice, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.signs import svhn
from modules.signs.boxes import around, square
from modules.signs.detector import Detector
from modules.signs.digits import LABELS, Digits
from modules.signs.drives import Passages, drive
from modules.signs.networks import find
from modules.signs.paddle import HEIGHT, Paddle
from modules.signs.reading import upright
from modules.signs.rendering import SETS, TEST_FONTS, any_number, render
from modules.signs.tracker import NUMBER
from modules.signs.watcher import Watcher
from robotkit import ConfigurationError
from robotkit.accuracy import Confusion

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from modules.signs.reading import Reader, Reading
    from modules.signs.rendering import Rendered
    from modules.signs.svhn import Number
    from robotkit.readings import Image

TEST_SEED = 1000
NOTHING = "-"
"""What stands for a digit that was not read, or for one that is not there."""


@dataclass
class Score:
    """Numbers or digits, how many were found, and how many were read right, by a reader."""

    count: int = 0
    found: int = 0
    right: int = 0
    boxed: int = 0
    confusion: Confusion = field(default_factory=Confusion)


class Judge:
    """Lets one reader read what others labelled."""

    def __init__(self, detector: Detector, reader: Reader) -> None:
        self._detector = detector
        self._reader = reader

    def numbers(self, found: Iterable[Number]) -> Score:
        """Format 1: found by the detector and read; and read where the box is given."""
        score = Score()
        for number in found:
            picture, truth = number.picture(), number.text
            readings = [self._read(picture, corners) for corners in self._detector.find(picture)]
            numbers = [reading for reading in readings if NUMBER.fullmatch(reading.text)]
            best = max(numbers, key=lambda reading: reading.confidence, default=None)
            boxed = self._read(picture, around(number.boxes, 0.15, 0.1)).text
            score.count += 1
            score.found += bool(readings)
            score.right += best is not None and best.text == truth
            score.boxed += boxed == truth
            for said, predicted in aligned(truth, boxed):
                score.confusion.add(said, predicted if predicted in LABELS else NOTHING)
        return score

    def digits(self, pictures: Image, labels: Sequence[str]) -> Score:
        """Format 2: which digit is in the middle."""
        score = Score()
        for picture, truth in zip(pictures, labels, strict=True):
            predicted = middle(self._reader.read(picture.astype(np.uint8, copy=False)))
            score.count += 1
            score.found += predicted != NOTHING
            score.right += predicted == truth
            score.confusion.add(truth, predicted)
        return score

    def _read(self, picture: Image, corners: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> Reading:
        return self._reader.read(upright(picture, corners, HEIGHT))


def middle(reading: Reading) -> str:
    """The digit nearest to the middle of what was read."""
    found = [character for character in reading.characters if character.label in LABELS]
    nearest = min(found, key=lambda character: abs(character.position - 0.5), default=None)
    return NOTHING if nearest is None else nearest.label


def aligned(truth: str, predicted: str) -> list[tuple[str, str]]:
    """Each character of both with its partner in the other, or with none."""
    pairs: list[tuple[str, str]] = []
    for _, begin, end, first, last in SequenceMatcher(None, truth, predicted, autojunk=False).get_opcodes():
        pairs += zip_longest(truth[begin:end], predicted[first:last], fillvalue=NOTHING)
    return pairs


def draw(folder: Path, count: int) -> list[Path]:
    """Signs of every set in both formats; returns the paths of their labels."""
    paths = []
    for index, (name, conditions) in enumerate(SETS.items()):
        rng = np.random.default_rng([TEST_SEED, index])
        signs = [render(any_number(rng), str(rng.choice(TEST_FONTS)), conditions(rng), rng) for _ in range(count)]
        paths.append(svhn.write_numbers(folder / name, [(sign.picture, sign.boxes) for sign in signs]))
        paths.append(folder / f"{name}_32x32.mat")
        cut = [one for sign in signs for one in _cut(sign)]
        svhn.write_digits(paths[-1], np.array([picture for picture, _ in cut]), [label for _, label in cut])
    return paths


def _cut(sign: Rendered) -> list[tuple[Image, str]]:
    """Each digit of a sign as SVHN cuts it: a square around its box."""
    return [(upright(sign.picture, square(box, 1.05), svhn.SIDE), box.label) for box in sign.boxes]


def judge(paths: Sequence[Path], judges: dict[str, Judge], limit: int | None) -> str:
    """A table of all files, then how the digits were confused in them, by each reader."""
    rows, confusions = [], {(name, form): Confusion() for name in judges for form in (1, 2)}
    for path in paths:
        for name, one in judges.items():
            if path.name == "digitStruct.mat":
                score, form = one.numbers(islice(svhn.numbers(path), limit)), 1
            else:
                pictures, labels = svhn.digits(path)
                score, form = one.digits(pictures[:limit], labels[:limit]), 2
            confusions[name, form].counts += score.confusion.counts
            rows.append(_row(path, form, name, score))
    head = ["set", "format", "reader", "count", "found", "found and read", "read in the given box"]
    table = "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])
    tables = [
        f"{name}, format {form}: digits, {confusion.accuracy:.1%} right\n\n{confusion.table()}"
        for (name, form), confusion in confusions.items()
        if confusion.counts
    ]
    return "\n\n".join([table, *tables])


def _row(path: Path, form: int, reader: str, score: Score) -> list[str]:
    def part(count: int) -> str:
        return f"{count / max(score.count, 1):.1%}"

    given = [part(score.found), part(score.right), part(score.boxed)] if form == 1 else ["", "", part(score.right)]
    name = path.parent.name if form == 1 else path.stem.removesuffix("_32x32")
    return [name, str(form), reader, str(score.count), *given]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; exit code 2 for a file that makes no sense."""
    parser = argparse.ArgumentParser(
        prog="python -m modules.signs.accuracy",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", type=Path, nargs="*", metavar="FILE")
    parser.add_argument("--rendered", type=Path, metavar="FOLDER")
    parser.add_argument("--count", type=int, default=100, help="signs to draw in each set")
    parser.add_argument("--limit", type=int, help="the most pictures to read of each file")
    parser.add_argument("--reader", choices=("paddle", "digits"), help="only this one")
    parser.add_argument("--drives", type=int, default=0, metavar="N")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    try:
        networks = find("")
        readers: dict[str, Reader] = {"paddle": Paddle(*networks.recognition()), "digits": Digits()}
        readers = {name: reader for name, reader in readers.items() if options.reader in {None, name}}
        detector = Detector(networks.detection())
        paths = [*options.files, *(draw(options.rendered, options.count) if options.rendered else [])]
        if paths:
            judges = {name: Judge(detector, reader) for name, reader in readers.items()}
            sys.stdout.write(f"{judge(paths, judges, options.limit)}\n")
        for name, reader in readers.items() if options.drives else ():
            driven = sum((drive(Watcher(detector, reader), seed) for seed in range(options.drives)), Passages())
            sys.stdout.write(f"drives, {name}: {driven.report()}\n")
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
