"""How far an estimated trajectory is from the truth: ATE and RPE, as evo computes them.

ATE is the distance between positions after the best rigid alignment (Umeyama 1991, without scale). RPE compares how
far both moved between two poses, so it needs no alignment; it shows drift where ATE shows its sum.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from modules.slam.geometry import apply, inverse, transform

if TYPE_CHECKING:
    from modules.slam.geometry import Floats
    from modules.slam.trajectory import Trajectory

    Unit = Literal["frames", "metres"]


def align(source: Floats, target: Floats) -> Floats:
    """Find the rigid `target_from_source` of least squares between N x 3 positions."""
    covariance = (target - target.mean(axis=0)).T @ (source - source.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left @ mirror @ right
    return transform(rotation, target.mean(axis=0) - rotation @ source.mean(axis=0))


def absolute_errors(estimated: Trajectory, truth: Trajectory) -> Floats:
    """Metres between positions of the same moments, after alignment (ATE)."""
    moved = apply(align(estimated.positions, truth.positions), estimated.positions)
    errors: Floats = np.linalg.norm(moved - truth.positions, axis=1)
    return errors


def relative_errors(estimated: Trajectory, truth: Trajectory, delta: float, unit: Unit) -> tuple[Floats, Floats]:
    """Metres and degrees by which movements over `delta` differ (RPE); pairs follow each other, as evo's do."""
    first, second = _steps(estimated, round(delta)) if unit == "frames" else _stretches(estimated, delta)
    moved, truly = (inverse(path.poses[first]) @ path.poses[second] for path in (estimated, truth))
    errors = inverse(truly) @ moved
    traces = np.trace(errors[:, :3, :3], axis1=1, axis2=2)
    sines = np.linalg.norm(errors[:, :3, :3] - np.swapaxes(errors[:, :3, :3], 1, 2), axis=(1, 2)) / np.sqrt(8)
    return np.linalg.norm(errors[:, :3, 3], axis=1), np.degrees(np.arctan2(sines, (traces - 1) / 2))


def end_drift(estimated: Trajectory, truth: Trajectory) -> float:
    """Metres between the last positions when the first poses are laid on each other."""
    truth_from_estimated = truth.poses[0] @ inverse(estimated.poses[0])
    return float(np.linalg.norm(apply(truth_from_estimated, estimated.positions[-1:]) - truth.positions[-1]))


def statistics(errors: Floats) -> dict[str, float]:
    """The figures that evo and TUM's tools print."""
    return {
        "rmse": float(np.sqrt(np.mean(errors**2))),
        "mean": float(np.mean(errors)),
        "median": float(np.median(errors)),
        "std": float(np.std(errors)),
        "min": float(np.min(errors)),
        "max": float(np.max(errors)),
    }


def _steps(path: Trajectory, frames: int) -> tuple[slice, slice]:
    """Poses that are this many apart, one after the other: 0 and n, n and 2n."""
    return slice(0, len(path) - frames, frames), slice(frames, len(path), frames)


def _stretches(path: Trajectory, metres: float) -> tuple[list[int], list[int]]:
    """Poses between which at least this many metres of path lie."""
    chosen, since = [0], 0.0
    for index, step in enumerate(np.linalg.norm(np.diff(path.positions, axis=0), axis=1), start=1):
        since += step
        if since >= metres:
            chosen.append(index)
            since = 0.0
    return chosen[:-1], chosen[1:]


def path_length(path: Trajectory) -> float:
    """Metres along the positions."""
    return float(np.linalg.norm(np.diff(path.positions, axis=0), axis=1).sum())
