"""Stereo visual odometry: where the robot is, from two pictures at a time.

Each left picture is matched with the last reference picture, whose points have depth from the right picture. The pose
that explains the matches best is the robot's. When too few matches are left, the picture becomes the new reference.
So a robot that stands still does not drift, and the right picture costs time only when there is a new reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np

from modules.slam.geometry import floats, transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from modules.slam.calibration import Rectifier
    from modules.slam.geometry import Floats, Image

    Descriptors: TypeAlias = NDArray[np.uint8]
    Indices: TypeAlias = NDArray[np.intp]

MAX_HAMMING = 60
MAX_ROW_ERROR = 2.0
MIN_DISPARITY = 1.0
MAX_REPROJECTION = 1.5
MIN_INLIERS = 15
REFERENCE_OVERLAP = 0.5


@dataclass(frozen=True)
class Pose:
    """The robot's body in the frame of its first picture; `inliers` is 0 when tracking was lost."""

    world_from_body: Floats
    inliers: int


@dataclass(frozen=True)
class _Features:
    points: Floats
    descriptors: Descriptors


@dataclass(frozen=True)
class _Reference:
    points: Floats
    descriptors: Descriptors
    world_from_camera: Floats


class Odometry:
    """Follows the robot from picture to picture; `features` may change between pictures."""

    def __init__(self, rectifier: Rectifier, *, features: int = 800) -> None:
        self.features = features
        self._rectifier = rectifier
        self._world_from_camera = rectifier.body_from_camera.copy()
        self._reference: _Reference | None = None

    def track(self, left: Image, right: Image) -> Pose:
        """Take one pair of raw pictures; a pair that cannot be matched keeps the last pose."""
        rectified = self._rectifier.left(left)
        features = self._detect(rectified)
        inliers = self._locate(features)
        if self._reference is None or inliers < REFERENCE_OVERLAP * len(self._reference.points):
            points, kept = self._measure(rectified, features, self._rectifier.right(right))
            self._reference = _Reference(points, features.descriptors[kept], self._world_from_camera)
        body_from_camera = self._rectifier.body_from_camera
        return Pose(self._world_from_camera @ np.linalg.inv(body_from_camera), inliers)

    def _detect(self, image: Image) -> _Features:
        orb = cv2.ORB.create(nfeatures=self.features, fastThreshold=12)
        keypoints, descriptors = orb.detectAndCompute(image, None)
        if descriptors is None:
            return _Features(np.empty((0, 2)), np.empty((0, 32), np.uint8))
        return _Features(np.array([point.pt for point in keypoints]), descriptors.astype(np.uint8))

    def _locate(self, features: _Features) -> int:
        """Move the camera to where the reference's points appear as they do; tell how many agree."""
        reference = self._reference
        if reference is None:
            return 0
        seen, known = _match(features.descriptors, reference.descriptors)
        if len(seen) < MIN_INLIERS:
            return 0
        solution = _solve(reference.points[known], features.points[seen], self._rectifier.matrix)
        if solution is None:
            return 0
        camera_from_reference, inliers = solution
        self._world_from_camera = reference.world_from_camera @ np.linalg.inv(camera_from_reference)
        return inliers

    def _measure(self, left: Image, features: _Features, right: Image) -> tuple[Floats, Indices]:
        """Give points of the left picture their place in space, in the camera's frame."""
        others = self._detect(right)
        same_row = np.abs(features.points[:, None, 1] - others.points[None, :, 1]) < MAX_ROW_ERROR
        to_the_left = features.points[:, None, 0] - others.points[None, :, 0] > MIN_DISPARITY
        kept, partners = _match(features.descriptors, others.descriptors, same_row & to_the_left)
        disparities, sharp = _disparities(left, right, features.points[kept], others.points[partners])
        return self._in_space(features.points[kept[sharp]], disparities[sharp]), kept[sharp]

    def _in_space(self, pixels: Floats, disparities: Floats) -> Floats:
        (focal, _, centre_x), (_, _, centre_y), _ = self._rectifier.matrix
        depths = focal * self._rectifier.baseline / disparities
        rays = np.column_stack([(pixels - (centre_x, centre_y)) / focal, np.ones(len(pixels))])
        points: Floats = rays * depths[:, None]
        return points


def _match(
    first: Descriptors, second: Descriptors, allowed: NDArray[np.bool_] | None = None
) -> tuple[Indices, Indices]:
    """Pair descriptors that are each other's nearest; returns indices into both."""
    if not len(first) or not len(second):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    mask = None if allowed is None else allowed.astype(np.uint8)
    distances, nearest = _nearest(first, second, mask)
    _, back = _nearest(second, first, None if mask is None else mask.T.copy())
    rows = np.arange(len(first))
    mutual = (nearest >= 0) & (back[nearest] == rows) & (distances < MAX_HAMMING)
    return rows[mutual], nearest[mutual]


def _nearest(first: Descriptors, second: Descriptors, mask: NDArray[np.uint8] | None) -> tuple[Indices, Indices]:
    """Distance to, and index of, the nearest in `second`; the index is -1 where the mask allows none."""
    distances, indices = cv2.batchDistance(first, second, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=1, mask=mask)
    return distances.ravel().astype(np.intp), indices.ravel().astype(np.intp)


def _disparities(left: Image, right: Image, points: Floats, guesses: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Sharpen matches to parts of a pixel: an ORB point is only as exact as its pyramid level."""
    if not len(points):
        return np.empty(0), np.empty(0, np.bool_)
    start = points.astype(np.float32)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        left, right, start, guesses.astype(np.float32), winSize=(11, 11), maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    shift = (start - found).astype(np.float64)
    sharp = (status.ravel() == 1) & (np.abs(shift[:, 1]) < MAX_ROW_ERROR) & (shift[:, 0] > MIN_DISPARITY)
    return shift[:, 0], sharp


def _solve(points: Floats, pixels: Floats, matrix: Floats) -> tuple[Floats, int] | None:
    """Find the camera that sees the points at the pixels: `camera_from_reference` and its inliers."""
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        points, pixels, matrix, None, reprojectionError=MAX_REPROJECTION, iterationsCount=100, confidence=0.999
    )
    if not found or inliers is None or len(inliers) < MIN_INLIERS:
        return None
    chosen = inliers.ravel()
    rotation, translation = cv2.solvePnPRefineLM(points[chosen], pixels[chosen], matrix, None, rotation, translation)
    return transform(floats(cv2.Rodrigues(rotation)[0]), floats(translation)), len(chosen)
