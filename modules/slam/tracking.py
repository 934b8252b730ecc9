"""Where the camera is, seen from a keyframe: its landmarks are looked for in the picture.

First by optical flow from where they are expected, which is exact to parts of a pixel and needs no features of the
picture. Where that finds too few, by features, anywhere in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.features import flow, match, sharpened
from modules.slam.geometry import apply, floats, inverse, transform
from modules.slam.pose_graph import Edge, Kind
from modules.slam.refinement import PIXEL_NOISE, Offset, Refiner, Sightings, turn_shifts
from modules.slam.uncertainty import chained

if TYPE_CHECKING:
    from modules.slam.calibration import Rectifier
    from modules.slam.features import Features, Indices, Mask, Picture, View
    from modules.slam.geometry import Floats
    from modules.slam.keyframes import Keyframe

MAX_REPROJECTION = 3.0
"""Pixels between where a landmark is seen and where it should be; ORB's coarser corners are no more exact."""
MIN_INLIERS = 20
"""Chance finds fewer."""
AGREEING = 0.3
"""The part of the landmarks looked for that must be where they should be."""
SURE_INLIERS = 40
"""With fewer, the landmarks are looked for in the whole picture, not only where they are expected."""
WIDE, NARROW = 100.0, 12.0
"""Pixels around the place where a landmark is expected: before and after the camera's turn is known."""
MIN_DEPTH = 0.1
MARGIN = 20
FOLLOWING = (11, 2)
"""Window in pixels, and levels of a pyramid, of the flow that follows landmarks."""
FEATURE_NOISE = 1.0
"""Standard deviation in pixels of where ORB sees a corner."""


@dataclass(frozen=True)
class Fix:
    """Where a camera is, seen from a keyframe, and how many of its landmarks say so.

    The covariance is that of a small shift, then turn, in the camera's axes (m2, rad2). `tried` landmarks were looked
    for; those that fit, `rows` of the keyframe, were seen at the pixels `seen`.
    """

    keyframe: Keyframe
    keyframe_from_camera: Floats
    inliers: int
    covariance: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    tried: int = 0
    misfit: float = 1.0
    disparity: float = np.inf
    """Mean in pixels, by itself weighted, as near landmarks say most of how far the camera went."""
    offset: Offset = field(default_factory=Offset)
    noise: float = PIXEL_NOISE
    """Standard deviation in pixels of where the landmarks were seen."""
    rows: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    seen: Floats = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def world_from_camera(self) -> Floats:
        """Where the camera is in the map."""
        return self.keyframe.world_from_camera @ self.keyframe_from_camera

    @property
    def covariance_in_map(self) -> Floats:
        """With what is uncertain about the keyframe itself."""
        return chained(self.keyframe.covariance, self.covariance, self.keyframe_from_camera)

    def edge_to(self, number: int, kind: Kind = Kind.SEEN) -> Edge:
        """What it says about the keyframe of this number, when the picture has become that."""
        return Edge(self.keyframe.number, number, self.keyframe_from_camera, self.inliers, kind, self.covariance)


class Tracker:
    """Locates the left one of two cameras."""

    def __init__(self, rectifier: Rectifier) -> None:
        self._matrix = rectifier.matrix
        self._size = rectifier.size
        self._disparity_metres = float(rectifier.matrix[0, 0]) * rectifier.baseline
        self._refiner = Refiner(rectifier)
        self.offset = Offset()
        """What is known of the right camera's turn against its calibration."""

    def follow(self, view: View, keyframe: Keyframe, world_from_camera: Floats) -> Fix | None:
        """Locate the camera, surely near this pose, if the keyframe still has its picture."""
        if keyframe.image is None or view.image is None:
            return None
        expected, visible = self._project(keyframe.points, inverse(keyframe.world_from_camera) @ world_from_camera)
        rows = np.flatnonzero(visible)
        pixels = self._pixels(keyframe.points[rows])
        found, sure = flow(keyframe.image, view.image, pixels, expected[rows], FOLLOWING)
        return self._solve(keyframe, rows[sure], found[sure], len(rows))

    def track(self, view: View, keyframe: Keyframe, world_from_camera: Floats) -> Fix | None:
        """Locate the camera, probably near this pose."""
        fix = self.follow(view, keyframe, world_from_camera)
        if fix is not None and fix.inliers >= max(SURE_INLIERS, AGREEING * fix.tried):
            return fix
        other = self._by_features(view, keyframe, world_from_camera)
        return max((one for one in (fix, other) if one is not None), key=lambda one: one.inliers, default=None)

    def _by_features(self, view: View, keyframe: Keyframe, world_from_camera: Floats) -> Fix | None:
        features, expected = view.features, inverse(keyframe.world_from_camera) @ world_from_camera
        fix = self._around(features, keyframe, expected, WIDE)
        if fix is None or fix.inliers < SURE_INLIERS:
            fix = self._anywhere(features, keyframe) or fix
        return fix and self._sharper(view, fix)

    def search(self, view: View, keyframe: Keyframe) -> Fix | None:
        """Locate the camera without knowing anything; then count all landmarks that are where they should be."""
        fix = self._anywhere(view.features, keyframe)
        return fix and self._sharper(view, fix)

    def confirm(self, fix: Fix, left: Picture, right: Picture) -> Fix | None:
        """Measure disparities in this picture too, and fit again, with depth at both ends; None if too few agree."""
        depths = apply(inverse(fix.keyframe_from_camera), fix.keyframe.points[fix.rows])[:, 2]
        shifts = self.offset.pixels * turn_shifts(self._matrix, fix.seen)
        guesses = fix.seen - np.column_stack([self._disparity_metres / depths + shifts, np.zeros(len(depths))])
        disparities = sharpened(left, right, fix.seen, guesses)
        confirmed, measured = self._fit(fix, disparities), fix.rows[np.isfinite(disparities)]
        agree = confirmed is not None and np.isin(measured, confirmed.rows).sum() >= MIN_INLIERS
        return confirmed if agree else None

    def _anywhere(self, features: Features, keyframe: Keyframe) -> Fix | None:
        fix = self._matched(features, keyframe, np.arange(len(keyframe)), None)
        return fix and self._around(features, keyframe, fix.keyframe_from_camera, NARROW)

    def _sharper(self, view: View, fix: Fix) -> Fix:
        """By flow from there, as that is more exact, unless much fewer landmarks agree on it."""
        flown = self.follow(view, fix.keyframe, fix.world_from_camera)
        return fix if flown is None or 2 * flown.inliers < fix.inliers else flown

    def _around(self, features: Features, keyframe: Keyframe, expected: Floats, radius: float) -> Fix | None:
        pixels, visible = self._project(keyframe.points, expected)
        rows = np.flatnonzero(visible)
        return self._matched(features, keyframe, rows, _near(features.pixels, pixels[rows], radius))

    def _project(self, points: Floats, keyframe_from_camera: Floats) -> tuple[Floats, Mask]:
        """Pixels of a keyframe's points, and which of them are in the picture or a little beside it."""
        seen = apply(inverse(keyframe_from_camera), points)
        ahead = seen[:, 2] > MIN_DEPTH
        pixels = self._pixels(np.where(ahead[:, None], seen, 1))
        inside = ((pixels > -MARGIN) & (pixels < np.add(self._size, MARGIN))).all(axis=1)
        return pixels, ahead & inside

    def _pixels(self, points: Floats) -> Floats:
        pixels: Floats = points / points[:, 2:] @ self._matrix[:2].T
        return pixels

    def _matched(self, features: Features, keyframe: Keyframe, rows: Indices, allowed: Mask | None) -> Fix | None:
        """Match these landmarks, and find the camera that explains most matches."""
        seen, known = match(features.descriptors, keyframe.descriptors[rows], allowed)
        return self._solve(keyframe, rows[known], features.pixels[seen], len(rows), FEATURE_NOISE)

    def _solve(
        self, keyframe: Keyframe, rows: Indices, seen: Floats, tried: int, noise: float = PIXEL_NOISE
    ) -> Fix | None:
        """Find the camera that explains most of what is seen, then the one that explains it best."""
        if len(rows) < MIN_INLIERS:
            return None
        start = _perspective(keyframe.points[rows], seen, self._matrix)
        if start is None:
            return None
        return self._fit(Fix(keyframe, start, 0, tried=tried, noise=noise, rows=rows, seen=seen))

    def _fit(self, fix: Fix, disparities: Floats | None = None) -> Fix | None:
        points = fix.keyframe.points[fix.rows]
        pixels, corrected = self._pixels(points), self._disparity_metres / points[:, 2]
        sightings = Sightings(
            pixels,
            corrected + fix.keyframe.offset * turn_shifts(self._matrix, pixels),
            fix.seen,
            np.full(len(points), np.nan) if disparities is None else disparities,
            fix.noise,
            self.offset,
        )
        fitted = self._refiner.fit(sightings, fix.keyframe_from_camera)
        count = int(fitted.fits.sum())
        if count < MIN_INLIERS or not np.isfinite(fitted.keyframe_from_camera).all():
            return None
        return replace(
            fix,
            keyframe_from_camera=fitted.keyframe_from_camera,
            inliers=count,
            covariance=fitted.covariance,
            misfit=fitted.misfit,
            disparity=_weighted_mean(corrected[fitted.fits]),
            offset=fitted.offset,
            rows=fix.rows[fitted.fits],
            seen=fix.seen[fitted.fits],
        )


def _weighted_mean(disparities: Floats) -> float:
    """The disparity whose error stretches the movement as much as the same error of all of them."""
    return float((disparities**2).sum() / disparities.sum())


def _near(first: Floats, second: Floats, radius: float) -> Mask:
    """Which pixels are near which others."""
    columns, rows = (
        np.abs(np.subtract.outer(*(pixels[:, axis].astype(np.float32) for pixels in (first, second)))) < radius
        for axis in (0, 1)
    )
    return columns & rows


def _perspective(points: Floats, pixels: Floats, matrix: Floats) -> Floats | None:
    """Find a camera that sees most of the points at the pixels: `points_from_camera`."""
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, matrix, None, reprojectionError=MAX_REPROJECTION, iterationsCount=100, confidence=0.999,
        flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not found or inliers is None or len(inliers) < MIN_INLIERS:
        return None
    camera_from_points = transform(floats(cv2.Rodrigues(rotation)[0]), floats(translation))
    return inverse(camera_from_points) if np.isfinite(camera_from_points).all() else None
