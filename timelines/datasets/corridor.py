"""Pictures of a textured corridor or hall, as a calibrated camera at a known place sees it.

The corridor is a box, and so is each block that stands in it. Each pixel's ray hits the nearest wall, so depth,
perspective and what hides what are exact; lens distortion comes from the camera's calibration. The same seed gives the
same pictures.
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
LOW = (-2.0, -1.6, -0.5)
HIGH_SIDE, CEILING = 1.6, 2.1


@dataclass(frozen=True)
class Hall:
    """A floor plan in metres: corners of the room and of the blocks in it, which reach from floor to ceiling."""

    low: tuple[float, float]
    high: tuple[float, float]
    blocks: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = ()


@dataclass(frozen=True)
class Box:
    """Six walls from `low` to `high`, with one texture per axis and side."""

    low: Floats
    high: Floats
    textures: tuple[tuple[Image, Image], ...]


@dataclass(frozen=True)
class Walls:
    """A room, seen from inside, and blocks in it, seen from outside."""

    room: Box
    blocks: tuple[Box, ...] = ()


def corridor(length: float) -> Hall:
    """Plan a straight corridor whose far end is `length` metres ahead of the start."""
    return Hall(LOW[:2], (length, HIGH_SIDE))


def build(hall: Hall, *, seed: int) -> Walls:
    """Raise and paint the walls of a plan."""
    rng = np.random.default_rng(seed)
    return Walls(_box(rng, hall.low, hall.high), tuple(_box(rng, *block) for block in hall.blocks))


def _box(rng: np.random.Generator, low: tuple[float, float], high: tuple[float, float]) -> Box:
    corners = np.array([(*low, LOW[2]), (*high, CEILING)], np.float32)
    size = (corners[1] - corners[0]) * PIXELS_PER_METRE
    sides = [(int(size[(axis + 1) % 3]), int(size[(axis + 2) % 3])) for axis in range(3)]
    return Box(corners[0], corners[1], tuple((_texture(rng, *side), _texture(rng, *side)) for side in sides))


def rays(camera: Camera) -> Floats:
    """Directions of all pixels in the camera's frame, 3 x (height * width), lens distortion included."""
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    straight = cv2.undistortPoints(pixels, camera.matrix, camera.distortion).reshape(-1, 2)
    return np.stack([straight[:, 0], straight[:, 1], np.ones(len(straight))]).astype(np.float32)


def picture(walls: Walls, directions: Floats, place: Floats, size: tuple[int, int]) -> Image:
    """Draw what is seen from `place` along `directions` (3 x pixels), both in the corridor's frame."""
    with np.errstate(divide="ignore"):
        view = _View(place, directions, np.reciprocal(directions))
    drawn, distances = _draw_room(walls.room, view)
    for block in walls.blocks:
        _draw_block(drawn, distances, block, view)
    return drawn.reshape(size[1], size[0])


@dataclass(frozen=True)
class _View:
    """Rays from a place, and how many of each direction's lengths make a metre along each axis."""

    place: Floats
    directions: Floats
    per_metre: Floats

    def reaches(self, wall: float, axis: int) -> Floats:
        """How far away a wall across an axis is, in lengths of the directions."""
        far: Floats = (np.float32(wall) - self.place[axis]) * self.per_metre[axis]
        return far


def _draw_room(room: Box, view: _View) -> tuple[Image, Floats]:
    """Draw the walls around; returns the pixels, and how far away they are."""
    nearest = np.full(view.directions.shape[1], np.inf, np.float32)
    wall = np.zeros(len(nearest), np.uint8)
    for axis in range(3):
        leaves = np.maximum(view.reaches(room.low[axis], axis), view.reaches(room.high[axis], axis))
        nearer = leaves < nearest
        nearest[nearer] = leaves[nearer]
        wall[nearer] = axis
    return _painted(room, view, nearest, wall, inside=True), nearest


def _draw_block(drawn: Image, distances: Floats, block: Box, view: _View) -> None:
    """Draw a block where it is nearer than what is drawn: a ray is inside while it is between all pairs of walls."""
    entered = np.zeros(len(drawn), np.float32)
    left = distances.copy()
    wall = np.zeros(len(drawn), np.uint8)
    for axis in range(3):
        low, high = view.reaches(block.low[axis], axis), view.reaches(block.high[axis], axis)
        enters = np.minimum(low, high)
        later = enters > entered
        entered[later] = enters[later]
        wall[later] = axis
        np.minimum(left, np.maximum(low, high), out=left)
    seen = np.flatnonzero((entered > 0) & (entered < left))
    part = _View(view.place, view.directions[:, seen], view.per_metre[:, seen])
    drawn[seen] = _painted(block, part, entered[seen], wall[seen], inside=False)


def _painted(box: Box, view: _View, distances: Floats, wall: Image, *, inside: bool) -> Image:
    """All rays' pixels: each reaches a wall across this axis, the high one if it leaves the box upwards."""
    drawn = np.zeros(len(wall), np.uint8)
    for axis in range(3):
        across = np.flatnonzero(wall == axis)
        upwards = view.directions[axis, across] > 0
        for side in range(2):
            here = across[upwards == (bool(side) is inside)]
            first, second = (axis + 1) % 3, (axis + 2) % 3
            rows, columns = (
                view.place[other] + view.directions[other, here] * distances[here] - box.low[other]
                for other in (first, second)
            )
            drawn[here] = _look_up(box.textures[axis][side], rows, columns)
    return drawn


def _look_up(texture: Image, rows: Floats, columns: Floats) -> Image:
    """The texture's brightness at places on a wall, in metres from its low corner."""
    looked_up = np.empty(len(rows), np.uint8)
    for start in range(0, len(rows), 32000):  # remap takes no side longer than 32767
        part = slice(start, start + 32000)
        x, y = columns[part] * PIXELS_PER_METRE, rows[part] * PIXELS_PER_METRE
        looked_up[part] = cv2.remap(texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()
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
