"""Where the camera is: features of a picture against landmarks whose places are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.features import match
from modules.slam.geometry import apply, floats, inverse, transform

if TYPE_CHECKING:
    from modules.slam.features import Descriptors, Features, Indices, Mask
    from modules.slam.geometry import Floats

MAX_REPROJECTION = 1.5
"""Pixels between where a landmark is seen and where it should be."""
MIN_INLIERS = 15
SURE_INLIERS = 40
"""With fewer than this, the landmarks are looked for in the whole picture, not only where they are expected."""
SEARCH_RADIUS = 40.0
"""Pixels around the place where a landmark is expected."""
MIN_DEPTH = 0.1
MARGIN = 20


@dataclass(frozen=True)
class Landmarks:
    """N landmarks of several keyframes: places in the world, descriptors, and whose they are (keyframe and row)."""

    places: Floats
    descriptors: Descriptors
    keyframes: Indices
    rows: Indices

    def __len__(self) -> int:
        return len(self.places)


@dataclass(frozen=True)
class Fix:
    """A camera that was located by landmarks: which features they are, whose, and in which row of their keyframe."""

    world_from_camera: Floats
    features: Indices
    keyframes: Indices
    rows: Indices

    def __len__(self) -> int:
        return len(self.features)

    @property
    def owners(self) -> dict[int, int]:
        """How many of the landmarks each keyframe owns."""
        owners, counts = np.unique(self.keyframes, return_counts=True)
        return dict(zip(owners.tolist(), counts.tolist(), strict=True))

    @property
    def mainly(self) -> int:
        """The keyframe that owns most of the landmarks."""
        owners = self.owners
        return max(owners, key=lambda number: owners[number])


class Tracker:
    """Locates a camera with this matrix and size (width, height) in pixels."""

    def __init__(self, matrix: Floats, size: tuple[int, int]) -> None:
        self._matrix = matrix
        self._size = size

    def track(self, features: Features, landmarks: Landmarks, expected: Floats) -> Fix | None:
        """Locate the camera near `expected` (`world_from_camera`), or anywhere if it is not there."""
        fix = self.confirm(features, landmarks, expected)
        return fix if fix is not None and len(fix) >= SURE_INLIERS else self.locate(features, landmarks) or fix

    def confirm(self, features: Features, landmarks: Landmarks, expected: Floats) -> Fix | None:
        """Locate the camera with the landmarks that appear near where they should."""
        pixels, visible = self._project(landmarks.places, expected)
        rows = np.flatnonzero(visible)
        return self._solve(features, landmarks, rows, _near(features.pixels, pixels[rows]))

    def locate(self, features: Features, landmarks: Landmarks) -> Fix | None:
        """Locate the camera without knowing anything."""
        return self._solve(features, landmarks, np.arange(len(landmarks)), None)

    def _project(self, places: Floats, world_from_camera: Floats) -> tuple[Floats, Mask]:
        """Pixels of places, and which of them are in the picture or a little beside it."""
        seen = apply(inverse(world_from_camera), places)
        ahead = seen[:, 2] > MIN_DEPTH
        flat = seen / np.where(ahead, seen[:, 2], 1)[:, None]
        pixels: Floats = flat @ self._matrix[:2].T
        inside = ((pixels > -MARGIN) & (pixels < np.add(self._size, MARGIN))).all(axis=1)
        return pixels, ahead & inside

    def _solve(self, features: Features, landmarks: Landmarks, rows: Indices, allowed: Mask | None) -> Fix | None:
        """Match, and find the camera that explains most matches."""
        seen, known = match(features.descriptors, landmarks.descriptors[rows], allowed)
        if len(seen) < MIN_INLIERS:
            return None
        solution = _perspective(landmarks.places[rows[known]], features.pixels[seen], self._matrix)
        if solution is None:
            return None
        camera_from_world, inliers = solution
        chosen = rows[known[inliers]]
        return Fix(inverse(camera_from_world), seen[inliers], landmarks.keyframes[chosen], landmarks.rows[chosen])


def _near(first: Floats, second: Floats) -> Mask:
    """Which pixels are within the search radius of which others."""
    columns, rows = (
        np.abs(np.subtract.outer(*(pixels[:, axis].astype(np.float32) for pixels in (first, second)))) < SEARCH_RADIUS
        for axis in (0, 1)
    )
    return columns & rows


def _perspective(places: Floats, pixels: Floats, matrix: Floats) -> tuple[Floats, Indices] | None:
    """Find the camera that sees the places at the pixels: `camera_from_world`, and the inliers."""
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        places, pixels, matrix, None, reprojectionError=MAX_REPROJECTION, iterationsCount=100, confidence=0.999
    )
    if not found or inliers is None or len(inliers) < MIN_INLIERS:
        return None
    chosen = inliers.ravel().astype(np.intp)
    rotation, translation = cv2.solvePnPRefineLM(places[chosen], pixels[chosen], matrix, None, rotation, translation)
    camera_from_world = transform(floats(cv2.Rodrigues(rotation)[0]), floats(translation))
    return (camera_from_world, chosen) if np.isfinite(camera_from_world).all() else None
