"""Where the camera is, seen from a keyframe: its landmarks are looked for in the picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.features import match
from modules.slam.geometry import apply, floats, inverse, transform

if TYPE_CHECKING:
    from modules.slam.features import Features, Indices, Mask
    from modules.slam.geometry import Floats
    from modules.slam.keyframes import Keyframe

MAX_REPROJECTION = 3.0
"""Pixels between where a landmark is seen and where it should be; ORB's coarser corners are no more exact."""
MIN_INLIERS = 15
SURE_INLIERS = 40
"""With fewer, the landmarks are looked for in the whole picture, not only where they are expected."""
WIDE, NARROW = 100.0, 12.0
"""Pixels around the place where a landmark is expected: before and after the camera's turn is known."""
MIN_DEPTH = 0.1
MARGIN = 20


@dataclass(frozen=True)
class Fix:
    """Where a camera is, seen from a keyframe, and how many of its landmarks say so."""

    keyframe: Keyframe
    keyframe_from_camera: Floats
    inliers: int

    @property
    def world_from_camera(self) -> Floats:
        """Where the camera is in the map."""
        return self.keyframe.world_from_camera @ self.keyframe_from_camera


class Tracker:
    """Locates a camera with this matrix and size (width, height) in pixels."""

    def __init__(self, matrix: Floats, size: tuple[int, int]) -> None:
        self._matrix = matrix
        self._size = size

    def track(self, features: Features, keyframe: Keyframe, world_from_camera: Floats) -> Fix | None:
        """Locate the camera, probably near this pose."""
        fix = self._around(features, keyframe, inverse(keyframe.world_from_camera) @ world_from_camera, WIDE)
        return fix if fix is not None and fix.inliers >= SURE_INLIERS else self.search(features, keyframe) or fix

    def search(self, features: Features, keyframe: Keyframe) -> Fix | None:
        """Locate the camera without knowing anything; then count all landmarks that are where they should be."""
        fix = self._solve(features, keyframe, np.arange(len(keyframe)), None)
        return fix and self._around(features, keyframe, fix.keyframe_from_camera, NARROW)

    def _around(self, features: Features, keyframe: Keyframe, expected: Floats, radius: float) -> Fix | None:
        pixels, visible = self._project(keyframe.points, expected)
        rows = np.flatnonzero(visible)
        return self._solve(features, keyframe, rows, _near(features.pixels, pixels[rows], radius))

    def _project(self, points: Floats, keyframe_from_camera: Floats) -> tuple[Floats, Mask]:
        """Pixels of a keyframe's points, and which of them are in the picture or a little beside it."""
        seen = apply(inverse(keyframe_from_camera), points)
        ahead = seen[:, 2] > MIN_DEPTH
        flat = seen / np.where(ahead, seen[:, 2], 1)[:, None]
        pixels: Floats = flat @ self._matrix[:2].T
        inside = ((pixels > -MARGIN) & (pixels < np.add(self._size, MARGIN))).all(axis=1)
        return pixels, ahead & inside

    def _solve(self, features: Features, keyframe: Keyframe, rows: Indices, allowed: Mask | None) -> Fix | None:
        """Match these landmarks, and find the camera that explains most matches."""
        seen, known = match(features.descriptors, keyframe.descriptors[rows], allowed)
        if len(seen) < MIN_INLIERS:
            return None
        solution = _perspective(keyframe.points[rows[known]], features.pixels[seen], self._matrix)
        return None if solution is None else Fix(keyframe, *solution)


def _near(first: Floats, second: Floats, radius: float) -> Mask:
    """Which pixels are near which others."""
    columns, rows = (
        np.abs(np.subtract.outer(*(pixels[:, axis].astype(np.float32) for pixels in (first, second)))) < radius
        for axis in (0, 1)
    )
    return columns & rows


def _perspective(points: Floats, pixels: Floats, matrix: Floats) -> tuple[Floats, int] | None:
    """Find the camera that sees the points at the pixels: `points_from_camera`, and how many agree."""
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, matrix, None, reprojectionError=MAX_REPROJECTION, iterationsCount=100, confidence=0.999,
        flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    if not found or inliers is None or len(inliers) < MIN_INLIERS:
        return None
    chosen = inliers.ravel()
    rotation, translation = cv2.solvePnPRefineLM(points[chosen], pixels[chosen], matrix, None, rotation, translation)
    camera_from_points = transform(floats(cv2.Rodrigues(rotation)[0]), floats(translation))
    return (inverse(camera_from_points), len(chosen)) if np.isfinite(camera_from_points).all() else None
