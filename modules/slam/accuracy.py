"""Absolute trajectory error (ATE) as the field measures it: align by rotation and shift, then compare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import transform

if TYPE_CHECKING:
    from modules.slam.geometry import Floats


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """Metres between matched positions, under the names that the TUM tools use."""

    pairs: int
    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float


def trajectory_error(estimated: Floats, truth: Floats) -> TrajectoryError:
    """Compare N x 3 positions of the same instants after the best rigid alignment."""
    truth_from_estimated = align(estimated, truth)
    moved = estimated @ truth_from_estimated[:3, :3].T + truth_from_estimated[:3, 3]
    errors = np.linalg.norm(moved - truth, axis=1)
    return TrajectoryError(
        pairs=len(errors),
        rmse=float(np.sqrt(np.mean(errors**2))),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        std=float(errors.std()),
        min=float(errors.min()),
        max=float(errors.max()),
    )


def align(source: Floats, target: Floats) -> Floats:
    """Find the rigid `target_from_source` of least squares (Umeyama, without scale)."""
    covariance = (target - target.mean(axis=0)).T @ (source - source.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left @ mirror @ right
    return transform(rotation, target.mean(axis=0) - rotation @ source.mean(axis=0))
