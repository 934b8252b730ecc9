"""What both networks share: a sign is cut out upright, and columns of probabilities become characters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from robotkit.readings import Image

    Array = NDArray[np.float32]

WIDEST = 12
"""Times its height: a wider text is not a number."""


@dataclass(frozen=True, slots=True)
class Character:
    """`position` is that of its middle, from 0 (left end of the text) to 1."""

    label: str
    confidence: float
    position: float


@dataclass(frozen=True, slots=True)
class Reading:
    """Characters from left to right."""

    characters: tuple[Character, ...] = ()

    @property
    def text(self) -> str:
        """What was read; empty for nothing."""
        return "".join(character.label for character in self.characters)

    @property
    def confidence(self) -> float:
        """From 0 to 1: how sure the least certain character is; 0 for nothing."""
        return min((character.confidence for character in self.characters), default=0.0)

    def stretched(self, factor: float) -> Reading:
        """The same, of a picture that was wider by this factor than its text."""
        return Reading(tuple(replace(one, position=min(one.position * factor, 1.0)) for one in self.characters))


class Reader(Protocol):
    """Reads a text that was cut out (BGR)."""

    def read(self, text: Image) -> Reading:
        """All of it, in one line."""


def upright(picture: Image, corners: Array, height: int) -> Image:
    """Cut a quadrangle (clockwise from its upper left corner) out, as a rectangle of this height."""
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    tall = max(float(sides[1] + sides[3]) / 2, 1)
    width = round(height * min(max(float(sides[0] + sides[2]) / 2 / tall, 0.25), WIDEST))
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    transform = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
    if tall > 2 * height:  # a warp takes single pixels, so what shrinks is made smooth first
        picture = cv2.GaussianBlur(picture, (0, 0), 0.4 * tall / height).astype(np.uint8, copy=False)
    cut = cv2.warpPerspective(picture, transform, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return cut.astype(np.uint8, copy=False)


def decode(columns: Array, labels: Sequence[str], blank: int) -> Reading:
    """The most likely label of each column; a run of the same one is one character (greedy CTC decoding).

    `labels` may hold fewer texts than a column has probabilities: the others are looked at for none.
    """
    best = columns.argmax(axis=1)
    edges = np.flatnonzero(np.diff(best, prepend=-1, append=-1))
    found = []
    for begin, end in pairwise(edges.tolist()):
        label = int(best[begin])
        if label != blank:
            middle = (begin + end) / 2 / len(columns)
            found.append(Character(labels[label], float(columns[begin:end, label].max()), middle))
    return Reading(tuple(found))
