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


def quaternion(rotation: Floats) -> tuple[float, float, float, float]:
    """Turn a 3x3 rotation into x, y, z, w with w >= 0."""
    vector = cv2.Rodrigues(rotation)[0].ravel()
    angle = float(np.linalg.norm(vector))
    x, y, z = vector * (np.sin(angle / 2) / angle if angle > 0 else 0.5)
    return float(x), float(y), float(z), float(np.cos(angle / 2))
