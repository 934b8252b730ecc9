"""What is seen: ORB features of a picture, their places in space by a second picture, and matches between features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from modules.slam.calibration import Rectifier
    from modules.slam.geometry import Floats, Image

    Descriptors: TypeAlias = NDArray[np.uint8]
    Indices: TypeAlias = NDArray[np.intp]
    Mask: TypeAlias = NDArray[np.bool_]

MAX_HAMMING = 60
MAX_ROW_ERROR = 2.0
MIN_DISPARITY = 1.0


@dataclass(frozen=True)
class Features:
    """N corners of a rectified picture: pixels, N x 2, and ORB descriptors, N x 32."""

    pixels: Floats
    descriptors: Descriptors

    def __len__(self) -> int:
        return len(self.pixels)


def detect(image: Image, count: int) -> Features:
    """Find at most `count` corners."""
    keypoints, descriptors = cv2.ORB.create(nfeatures=count, fastThreshold=12).detectAndCompute(image, None)
    if descriptors is None:
        return Features(np.empty((0, 2)), np.empty((0, 32), np.uint8))
    return Features(np.array([point.pt for point in keypoints]), descriptors.astype(np.uint8))


def match(first: Descriptors, second: Descriptors, allowed: Mask | None = None) -> tuple[Indices, Indices]:
    """Pair descriptors that are each other's nearest among the allowed pairs; returns indices into both."""
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


def measure(rectifier: Rectifier, left: Image, right: Image, features: Features) -> Floats:
    """Places of the left picture's features in the camera's frame, N x 3 metres; NaN where the depth is unknown."""
    others = detect(right, len(features))
    same_row = np.abs(features.pixels[:, None, 1] - others.pixels[None, :, 1]) < MAX_ROW_ERROR
    to_the_left = features.pixels[:, None, 0] - others.pixels[None, :, 0] > MIN_DISPARITY
    kept, partners = match(features.descriptors, others.descriptors, same_row & to_the_left)
    points = np.full((len(features), 3), np.nan)
    points[kept] = _in_space(
        rectifier, features.pixels[kept], _disparities(left, right, features.pixels[kept], others.pixels[partners])
    )
    return points


def _disparities(left: Image, right: Image, pixels: Floats, guesses: Floats) -> Floats:
    """Sharpen matches to parts of a pixel, as ORB is only as exact as its pyramid level; NaN where that fails."""
    if not len(pixels):
        return np.empty(0)
    start = pixels.astype(np.float32)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        left, right, start, guesses.astype(np.float32), winSize=(11, 11), maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    shift = (start - found).astype(np.float64)
    sharp = (status.ravel() == 1) & (np.abs(shift[:, 1]) < MAX_ROW_ERROR) & (shift[:, 0] > MIN_DISPARITY)
    disparities: Floats = np.where(sharp, shift[:, 0], np.nan)
    return disparities


def _in_space(rectifier: Rectifier, pixels: Floats, disparities: Floats) -> Floats:
    (focal, _, centre_x), (_, _, centre_y), _ = rectifier.matrix
    depths = focal * rectifier.baseline / disparities
    rays = np.column_stack([(pixels - (centre_x, centre_y)) / focal, np.ones(len(pixels))])
    points: Floats = rays * depths[:, None]
    return points
