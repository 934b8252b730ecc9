"""What is seen: ORB features of a picture, matches between features, and disparities by a second picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, TypeAlias

import cv2
import numpy as np

from modules.slam.geometry import floats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from modules.slam.geometry import Floats, Image

    Descriptors: TypeAlias = NDArray[np.uint8]
    Indices: TypeAlias = NDArray[np.intp]
    Mask: TypeAlias = NDArray[np.bool_]

MAX_HAMMING = 60
MAX_ROW_ERROR = 2.0
MIN_DISPARITY = 1.5
"""Five standard deviations of the noise: below, a landmark may be anywhere."""
COARSENESS, COARSE_BEYOND, COARSE_RANGE, COARSE_BLOCK = 3, 5, 64, 9
"""Pictures a third as wide and high, and in their pixels: disparities that are searched, some behind infinity, as what
matches best there has no depth or the calibration is wrong; and the blocks that are compared."""
MOST_CORRECTION = 3.0
"""Pixels by which a coarse disparity may be wrong."""
CANDIDATES, CELL = 3, 32
"""Corners that are looked for, as a multiple of those kept; and the side in pixels of the cells that share them."""
LEVELS, STEP = 4, 1.4
"""How often, and by what, the picture is made smaller to find corners of other sizes: the places of those that are
found in smaller ones are less exact."""
SHARPENING = (11, 0)
"""Pixels, and levels of a pyramid, that flow takes to find a corner's place to parts of a pixel."""
STEPS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
"""When flow has converged: after so many steps, or one shorter than this, in pixels."""
MOST_DIFFERENCE = 20.0
"""Mean difference in brightness (of 255) of what is the same: flow stays at its guess where it finds nothing alike."""
BRIGHT, MOST_GAIN = 200, 12
"""The brightness (of 255) that a dark picture's brightest parts are raised to, and the largest gain."""
BLOCKS = (16, 8)
"""Blocks across and down a picture, whose brightness is compared between the cameras."""
DARK = 1.0
"""The brightness (of 255) below which a block says nothing: at night most may be black."""
GRAINY = 3.0
"""The gain from which the picture is smoothed, as noise has been raised as well."""


@dataclass(frozen=True)
class Features:
    """N corners of a rectified picture: pixels, N x 2, and ORB descriptors, N x 32."""

    pixels: Floats
    descriptors: Descriptors

    def __len__(self) -> int:
        return len(self.pixels)


class View(Protocol):
    """What can be located: a picture, or a keyframe, of which only the features may be left."""

    @property
    def image(self) -> Image | None:
        """The picture itself."""

    @property
    def features(self) -> Features:
        """Its corners."""


class Picture:
    """A rectified picture; its features are looked for only when they are needed, as that takes the most time."""

    def __init__(self, image: Image, count: int) -> None:
        self.image = lit(image)
        self._count = count

    @cached_property
    def features(self) -> Features:
        """At most as many corners as asked for."""
        return detect(self.image, self._count)


def lit(image: Image) -> Image:
    """A dark picture as if there were more light: corners are found by their contrast."""
    gain = min(BRIGHT / max(float(np.percentile(image[::8, ::8], 99)), 1), MOST_GAIN)
    if gain <= 1:
        return image
    brighter = cv2.convertScaleAbs(image, alpha=gain)
    return (cv2.GaussianBlur(brighter, (5, 5), 0) if gain > GRAINY else brighter).astype(np.uint8, copy=False)


def balanced(image: Image, other: Image) -> Image:
    """A picture made as bright as one of the same place, because flow compares brightness."""
    here, there = _blocks(image), _blocks(other)
    seen = np.minimum(here, there) >= DARK
    gain = float(np.median(there[seen] / here[seen])) if seen.any() else 1.0
    return cv2.convertScaleAbs(image, alpha=min(gain, MOST_GAIN)).astype(np.uint8, copy=False)


def _blocks(image: Image) -> Floats:
    """Mean brightness of blocks so wide that both cameras see mostly the same in each."""
    return floats(cv2.resize(image[::4, ::4].astype(np.float32), BLOCKS, interpolation=cv2.INTER_AREA))


def detect(image: Image, count: int) -> Features:
    """Find at most `count` corners, all over the picture: the strongest of each cell first, then the second ones."""
    orb = cv2.ORB.create(
        nfeatures=CANDIDATES * count, nlevels=LEVELS, scaleFactor=STEP, fastThreshold=12, edgeThreshold=19
    )
    found = orb.detect(image, None)
    chosen: Sequence[int] = _spread(found)[:count].tolist() if found else []
    keypoints, descriptors = orb.compute(image, [found[index] for index in chosen])
    if descriptors is None:
        return Features(np.empty((0, 2)), np.empty((0, 32), np.uint8))
    return Features(np.array(cv2.KeyPoint.convert(keypoints), np.float64), descriptors.astype(np.uint8))


def _spread(keypoints: Sequence[cv2.KeyPoint]) -> Indices:
    """Indices in the order of their rank in their cell, and of their strength among those of the same rank."""
    strengths = np.array([point.response for point in keypoints])
    columns, rows = (np.array(cv2.KeyPoint.convert(keypoints)) // CELL).astype(np.intp).T
    cells = rows * (columns.max() + 1) + columns
    order = np.lexsort((-strengths, cells))
    counts = np.unique(cells, return_counts=True)[1]
    ranks = np.empty(len(cells), np.intp)
    ranks[order] = np.arange(len(cells)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.lexsort((-strengths, ranks))


def match(first: Descriptors, second: Descriptors, allowed: Mask | None = None) -> tuple[Indices, Indices]:
    """Pair descriptors that are each other's nearest among the allowed pairs; returns indices into both."""
    if not len(first) or not len(second):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    distances = _hamming(first, second)
    if allowed is not None:
        distances[~allowed] = MAX_HAMMING
    rows, nearest, back = np.arange(len(first)), distances.argmin(axis=1), distances.argmin(axis=0)
    mutual = (back[nearest] == rows) & (distances[rows, nearest] < MAX_HAMMING)
    return rows[mutual], nearest[mutual]


def _hamming(first: Descriptors, second: Descriptors) -> NDArray[np.uint16]:
    """How many bits differ, of each of the first from each of the second; 8 bytes at once."""
    distances = np.zeros((len(first), len(second)), np.uint16)
    columns = (np.ascontiguousarray(each.view(np.uint64).T) for each in (first, second))
    for one, other in zip(*columns, strict=True):
        distances += np.bitwise_count(one[:, None] ^ other)
    return distances


def measure(left: Picture, right: Picture) -> Floats:
    """Disparities of the left picture's features, NaN where unknown; what matches best behind infinity is unknown."""
    pixels = left.features.pixels
    disparities = np.full(len(pixels), np.nan)
    if len(pixels):
        coarse = _coarse(left.image, right.image, pixels)
        known = np.flatnonzero(coarse > 0)
        guesses = pixels[known] - np.column_stack([coarse[known], np.zeros(len(known))])
        fine = sharpened(left, right, pixels[known], guesses)
        disparities[known] = np.where(np.abs(fine - coarse[known]) < MOST_CORRECTION, fine, np.nan)
    return disparities


def _coarse(left: Image, right: Image, pixels: Floats) -> Floats:
    """Disparities by block matching in smaller pictures; negative where nothing matches."""
    matcher = cv2.StereoBM.create(COARSE_RANGE, COARSE_BLOCK)
    matcher.setMinDisparity(-COARSE_BEYOND)
    part = 1 / COARSENESS
    small = (cv2.resize(picture, None, fx=part, fy=part, interpolation=cv2.INTER_AREA) for picture in (left, right))
    wide = (cv2.copyMakeBorder(one, 0, 0, COARSE_RANGE, COARSE_BEYOND, cv2.BORDER_REPLICATE) for one in small)
    found = matcher.compute(*wide)[:, COARSE_RANGE:-COARSE_BEYOND]
    places = (pixels.T + 0.5) / COARSENESS
    columns, rows = np.minimum(places, np.array(found.shape[::-1])[:, None] - 1).astype(np.intp)
    disparities: Floats = found[rows, columns] / 16.0 * COARSENESS  # it counts sixteenths of a pixel
    return disparities


def sharpened(left: Picture, right: Picture, pixels: Floats, guesses: Floats) -> Floats:
    """Disparities to parts of a pixel, as ORB is only as exact as its pyramid level; NaN where that fails."""
    found, sure = flow(left.image, right.image, pixels, guesses, SHARPENING)
    shift = pixels - found
    sharp = sure & (np.abs(shift[:, 1]) < MAX_ROW_ERROR) & (shift[:, 0] > MIN_DISPARITY)
    disparities: Floats = np.where(sharp, shift[:, 0], np.nan)
    return disparities


def flow(first: Image, second: Image, pixels: Floats, guesses: Floats, reach: tuple[int, int]) -> tuple[Floats, Mask]:
    """Where pixels of the first are in the second (Lucas-Kanade), and which were found; `reach`: window, levels."""
    if not len(pixels):
        return np.empty((0, 2)), np.empty(0, np.bool_)
    found, status, difference = cv2.calcOpticalFlowPyrLK(
        first, second, pixels.astype(np.float32), guesses.astype(np.float32),
        winSize=(reach[0], reach[0]), maxLevel=reach[1], criteria=STEPS, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    return floats(found), (status.ravel() == 1) & (difference.ravel() < MOST_DIFFERENCE)
