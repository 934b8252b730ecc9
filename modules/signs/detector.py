"""Where texts are in a picture: PP-OCR's detection network, and boxes around what it marks.

The network marks the cores of texts, shrunk so that neighbours stay apart (Liao et al., "Real-time Scene Text Detection
with Differentiable Binarization", 2020); boxes are grown again by the same rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from modules.signs.reading import Array
    from robotkit.readings import Image

LIKELY = 0.3
"""From where on a pixel belongs to a text."""
SURE = 0.5
"""Mean likelihood that a text needs."""
_GROWN = 1.6
"""How much the distance is that a box grows by, in parts of its area over its circumference."""
_MULTIPLE = 32
"""The network halves pictures five times."""
_MOST = 12
"""Texts that are looked at in one picture, the largest ones."""
_BRIGHT, _MOST_GAIN = 200, 8
_SMALLEST = 3


@dataclass(frozen=True)
class Region:
    """The part of a picture that is looked at; edges from 0 to 1."""

    left: float = 0
    top: float = 0
    right: float = 1
    bottom: float = 1

    @classmethod
    def parse(cls, text: str) -> Region:
        """Read `left top right bottom`; ValueError says what is wrong."""
        try:
            left, top, right, bottom = map(float, text.split())
        except ValueError:
            left = top = right = bottom = math.nan
        region = cls(left, top, right, bottom)
        if 0 <= region.left < region.right <= 1 and 0 <= region.top < region.bottom <= 1:
            return region
        raise ValueError("left, top, right and bottom from 0 to 1, as in '0 0.1 1 0.7'")

    def of(self, picture: Image) -> tuple[Image, Array]:
        """The part, and where its upper left corner is in the picture."""
        height, width = picture.shape[:2]
        left, top = int(self.left * width), int(self.top * height)
        part = picture[top : max(round(self.bottom * height), top + 1), left : max(round(self.right * width), left + 1)]
        return part, np.array([left, top], np.float32)


class Detector:
    """Finds texts. `side` is the longer side, in pixels, that a picture is shrunk to: work grows with its square."""

    def __init__(self, network: cv2.dnn.Net, region: Region = Region(), side: int = 736) -> None:
        self._network = network
        self._region = region
        self.side = side

    def find(self, picture: Image) -> list[Array]:
        """The corners of texts, clockwise from the upper left one; texts that the region cuts are left out."""
        part, origin = self._region.of(picture)
        height, width = part.shape[:2]
        scale = min(self.side / max(width, height), 1.0 if max(width, height) > 320 else 320 / max(width, height))
        size = _rounded(width * scale), _rounded(height * scale)
        sized = lit(cv2.resize(part, size).astype(np.uint8, copy=False))
        self._network.setInput(cv2.dnn.blobFromImage(sized, 1 / 127.5, size, (127.5, 127.5, 127.5)))
        likely = np.asarray(self._network.forward(), np.float32)[0, 0]
        grown = np.array([width / size[0], height / size[1]], np.float32)
        found = [corners * grown for corners in boxes(likely)]
        whole = [corners for corners in found if _inside(corners, width, height)]
        return [(corners + origin).astype(np.float32) for corners in sorted(whole, key=_area, reverse=True)[:_MOST]]


def lit(picture: Image) -> Image:
    """A dark picture as if there were more light: the network was trained on daylight."""
    gain = min(_BRIGHT / max(float(np.percentile(picture[::4, ::4], 99)), 1), _MOST_GAIN)
    return cv2.convertScaleAbs(picture, alpha=gain).astype(np.uint8, copy=False) if gain > 1 else picture


def boxes(likely: Array) -> list[Array]:
    """The corners of every text in a map of how likely each pixel is one's."""
    contours, _ = cv2.findContours((likely > LIKELY).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    found = []
    for contour in contours:
        (x, y), (width, height), angle = cv2.minAreaRect(contour)
        width, height = width + 1, height + 1  # a contour runs through the middles of pixels
        if min(width, height) < _SMALLEST or _mean(likely, np.asarray(contour)) < SURE:
            continue
        growth = 2 * width * height * _GROWN / (2 * (width + height))
        corners = cv2.boxPoints(((x, y), (width + growth, height + growth), angle))
        found.append(_clockwise(np.asarray(corners, np.float32) + 0.5))
    return found


def _mean(likely: Array, contour: np.ndarray[tuple[int, ...], np.dtype[np.int32]]) -> float:
    x, y, width, height = cv2.boundingRect(contour)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [contour - np.array([x, y], np.int32)], 1)
    return float(cv2.mean(likely[y : y + height, x : x + width], mask)[0])


def _clockwise(corners: Array) -> Array:
    """Begin with the corner whose side is the nearest to a text's upper edge: signs are not upside down."""
    sides = np.roll(corners, -1, axis=0) - corners
    first = int(np.argmax(sides[:, 0] / np.maximum(np.linalg.norm(sides, axis=1), 1e-6)))
    return np.roll(corners, -first, axis=0)


def _inside(corners: Array, width: int, height: int) -> bool:
    """Whether all of a text is seen; one that the left or right edge cuts would be half a number."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    tall = float(np.linalg.norm(corners[3] - corners[0]))
    beside, above = 0.03 * tall + 1, 0.1 * tall + 1
    across = low[0] > -beside and high[0] < width + beside
    return bool(across and low[1] > -above and high[1] < height + above)


def _area(corners: Array) -> float:
    return float(cv2.contourArea(corners))


def _rounded(length: float) -> int:
    return max(round(length / _MULTIPLE), 1) * _MULTIPLE
