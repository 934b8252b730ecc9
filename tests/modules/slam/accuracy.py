"""Absolute trajectory error (ATE) as the field measures it: align by rotation and shift, then compare."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import transform

if TYPE_CHECKING:
    from modules.slam.geometry import Floats


def trajectory_rmse(estimated: Floats, truth: Floats) -> float:
    """Metres between N x 3 positions of the same instants after the best rigid alignment, root mean square."""
    truth_from_estimated = align(estimated, truth)
    moved = estimated @ truth_from_estimated[:3, :3].T + truth_from_estimated[:3, 3]
    errors = np.linalg.norm(moved - truth, axis=1)
    return float(np.sqrt(np.mean(errors**2)))


def align(source: Floats, target: Floats) -> Floats:
    """Find the rigid `target_from_source` of least squares (Umeyama, without scale)."""
    covariance = (target - target.mean(axis=0)).T @ (source - source.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left @ mirror @ right
    return transform(rotation, target.mean(axis=0) - rotation @ source.mean(axis=0))
