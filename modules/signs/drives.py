"""A robot drives along a wall with signs and back, as its side camera sees it, to count how often each is reported."""

from __future__ import annotations

from collections import Counter
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.signs.rendering import FOCAL, TEST_FONTS, Conditions, any_number, render

if TYPE_CHECKING:
    from collections.abc import Iterator

    from modules.signs.watcher import Watcher
    from robotkit.readings import Image

SIZE = (752, 480)
RATE = 3
"""Pictures a second."""
SPEED, DISTANCE, APART = 0.5, 1.5, 3.5
"""m/s along the wall, m from it, and m between signs: there is a second without any sign."""
DIGIT = 0.06
"""Height of a digit in m."""
_SIGNS = 3


@dataclass
class Passages:
    """Passages of signs, and what became of them."""

    passages: int = 0
    once: int = 0
    wrong: int = 0
    again: int = 0
    pictures: int = 0

    def __add__(self, other: Passages) -> Passages:
        return Passages(*(mine + its for mine, its in zip(astuple(self), astuple(other), strict=True)))

    def report(self) -> str:
        """One line."""
        missed = self.passages - self.once
        return (
            f"{self.passages} passages in {self.pictures} pictures: reported {self.once}, missed {missed}, "
            f"reported again {self.again}, read wrongly {self.wrong}"
        )


def drive(watcher: Watcher, seed: int) -> Passages:
    """Drive along three signs and back, so that each passes by twice."""
    rng = np.random.default_rng(seed)
    signs = [(any_number(rng), str(rng.choice(TEST_FONTS)), seed * 100 + index) for index in range(_SIGNS)]
    score = Passages()
    for way in (positions(), reversed(list(positions()))):
        reported = []
        for position in way:
            score.pictures += 1
            stamp = round(score.pictures / RATE * 1e9)
            reported += [sign.text for sign in watcher.watch(_picture(signs, position), stamp)]
        _count(score, Counter(text for text, _, _ in signs), Counter(reported))
    return score


def positions() -> Iterator[float]:
    """Where the robot is along the wall, picture by picture, in m."""
    first, last = -0.5 * APART, (_SIGNS - 0.5) * APART
    yield from np.arange(first, last, SPEED / RATE).tolist()


def _count(score: Passages, truth: Counter[str], reported: Counter[str]) -> None:
    score.passages += truth.total()
    score.once += (truth & reported).total()
    for text, count in (reported - truth).items():
        if text in truth:
            score.again += count
        else:
            score.wrong += count


def _picture(signs: list[tuple[str, str, int]], position: float) -> Image:
    """The nearest sign; a wall alone when none is near."""
    index = min(max(round(position / APART), 0), len(signs) - 1)
    text, font, seed = signs[index]
    offset = (index * APART - position) / DISTANCE
    conditions = Conditions(height=FOCAL * DIGIT / DISTANCE, motion=2, blur=0.7, light=0.8)
    middle = (SIZE[0] / 2 + FOCAL * offset, SIZE[1] * 0.4)
    return render(text, font, conditions, np.random.default_rng(seed), size=SIZE, middle=middle).picture
