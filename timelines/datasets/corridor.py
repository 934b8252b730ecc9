"""Pictures of a textured corridor, as a calibrated camera at a known place sees it.

The corridor is a box. Each pixel's ray hits the nearest wall, so depth and perspective are exact; lens distortion comes
from the camera's calibration. The same seed gives the same pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from modules.slam.calibration import Camera

    Floats = NDArray[np.float32]
    Image = NDArray[np.uint8]

PIXELS_PER_METRE = 100
LOW = np.array([-2.0, -1.6, -0.5], np.float32)
WIDTH_AND_HEIGHT = np.array([3.2, 2.6], np.float32)


@dataclass(frozen=True)
class Corridor:
    """A box from LOW to `high`, in metres, with one texture per axis and side."""

    high: Floats
    textures: tuple[tuple[Image, Image], ...]


def build(*, length: float, seed: int) -> Corridor:
    """Make a corridor whose far end is `length` metres ahead of the start."""
    rng = np.random.default_rng(seed)
    high = np.array([length, *(LOW[1:] + WIDTH_AND_HEIGHT)], np.float32)
    size = (high - LOW) * PIXELS_PER_METRE
    sides = [(int(size[(axis + 1) % 3]), int(size[(axis + 2) % 3])) for axis in range(3)]
    textures = tuple((_texture(rng, *side), _texture(rng, *side)) for side in sides)
    return Corridor(high, textures)


def rays(camera: Camera) -> Floats:
    """Directions of all pixels in the camera's frame, (height * width) x 3, lens distortion included."""
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    straight = cv2.undistortPoints(pixels, camera.matrix, camera.distortion).reshape(-1, 2)
    return np.column_stack([straight, np.ones(len(straight))]).astype(np.float32)


def picture(corridor: Corridor, directions: Floats, place: Floats, size: tuple[int, int]) -> Image:
    """Draw what is seen from `place` along `directions`, both in the corridor's frame."""
    walls = np.where(directions > 0, corridor.high, LOW)
    with np.errstate(divide="ignore"):
        distances = (walls - place) / directions
    nearest = distances.argmin(axis=1)
    hits = place + directions * distances.min(axis=1, keepdims=True)
    ahead = np.take_along_axis(directions, nearest[:, None], axis=1).ravel() > 0
    drawn = np.zeros(len(directions), np.uint8)
    for axis in range(3):
        for side in range(2):
            here = np.flatnonzero((nearest == axis) & (ahead == bool(side)))
            drawn[here] = _look_up(corridor.textures[axis][side], hits[here], axis)
    return drawn.reshape(size[1], size[0])


def _look_up(texture: Image, hits: Floats, axis: int) -> Image:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rows = (hits[:, first] - LOW[first]) * PIXELS_PER_METRE
    columns = (hits[:, second] - LOW[second]) * PIXELS_PER_METRE
    looked_up = np.empty(len(hits), np.uint8)
    for start in range(0, len(hits), 32000):  # remap takes no side longer than 32767
        part = slice(start, start + 32000)
        looked_up[part] = cv2.remap(
            texture, columns[part], rows[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ).ravel()
    return looked_up


def _texture(rng: np.random.Generator, height: int, width: int) -> Image:
    """Plaster of several grain sizes with posters on it: corners at every distance."""
    plaster = np.full((height, width), 110.0, np.float32)
    for grain, contrast in ((64, 30), (16, 22), (5, 18)):
        coarse = rng.normal(0, contrast, (height // grain + 2, width // grain + 2)).astype(np.float32)
        plaster += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(height * width // 1500):
        row, column = rng.integers(0, height), rng.integers(0, width)
        tall, wide = rng.integers(4, 40, 2)
        plaster[row : row + tall, column : column + wide] += rng.normal(0, 60)
    return np.clip(cv2.GaussianBlur(plaster, (3, 3), 0.7), 5, 250).astype(np.uint8)
