"""Names for arrays, and rigid transforms as 4x4 matrices called `target_from_source`."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Image: TypeAlias = NDArray[np.uint8]


def floats(values: NDArray[Any]) -> Floats:
    """Name the type of what OpenCV returns: its own signatures leave it open."""
    return values.astype(np.float64, copy=False)


def transform(rotation: Floats, translation: Floats) -> Floats:
    """Join a 3x3 rotation and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation.ravel()
    return matrix


def inverse(matrix: Floats) -> Floats:
    """`source_from_target`, for one transform or N of them."""
    turned = np.swapaxes(matrix[..., :3, :3], -1, -2)
    inverted = np.zeros_like(matrix)
    inverted[..., :3, :3] = turned
    inverted[..., :3, 3:] = -turned @ matrix[..., :3, 3:]
    inverted[..., 3, 3] = 1
    return inverted


def apply(matrix: Floats, points: Floats) -> Floats:
    """Move N x 3 points."""
    there: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return there


def moved(matrix: Floats) -> float:
    """How far a transform shifts, in metres."""
    return float(np.linalg.norm(matrix[:3, 3]))


def angle(matrix: Floats) -> float:
    """How far a transform turns, in radians."""
    sine = np.linalg.norm(matrix[:3, :3] - matrix[:3, :3].T) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(matrix[:3, :3]) - 1) / 2))


def quaternion(rotation: Floats) -> tuple[float, float, float, float]:
    """Turn a 3x3 rotation into x, y, z, w with w >= 0."""
    vector = cv2.Rodrigues(rotation)[0].ravel()
    turn = float(np.linalg.norm(vector))
    x, y, z = vector * (np.sin(turn / 2) / turn if turn > 0 else 0.5)
    return float(x), float(y), float(z), float(np.cos(turn / 2))


def rotations(quaternions: Floats) -> Floats:
    """Turn N quaternions x, y, z, w of any length but 0 into N x 3 x 3 rotations."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def twist(step: Floats) -> Floats:
    """The small movement of a shift (3) and a turn (3, radians)."""
    return transform(floats(cv2.Rodrigues(step[3:])[0]), step[:3])
