"""Trajectories in TUM's format, `seconds x y z qx qy qz qw` a line, and those of recorded sequences.

Stamps are kept in ns as integers: a float of seconds since 1970 is not exact enough to name a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import rotations
from modules.slam.sequences import truth
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from modules.slam.geometry import Floats

    Stamps = NDArray[np.int64]

MAX_DIFFERENCE_NS = 10_000_000
"""How far apart the stamps of one moment may be: evo's default, 0.01 s."""


class TrajectoryError(ConfigurationError):
    """A file that is not a trajectory, or two trajectories that can't be compared."""


@dataclass(frozen=True)
class Trajectory:
    """N poses in the order of their stamps (ns): positions, N x 3 metres, and quaternions x, y, z, w, N x 4."""

    stamps: Stamps
    positions: Floats
    orientations: Floats

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def poses(self) -> Floats:
        """N x 4 x 4 transforms."""
        matrices = np.tile(np.eye(4), (len(self), 1, 1))
        matrices[:, :3, :3] = rotations(self.orientations)
        matrices[:, :3, 3] = self.positions
        return matrices

    def at(self, indices: Sequence[int] | NDArray[np.intp]) -> Trajectory:
        """These poses only."""
        return Trajectory(self.stamps[indices], self.positions[indices], self.orientations[indices])


def trajectory(rows: Iterable[tuple[int, Sequence[float]]]) -> Trajectory:
    """A trajectory of stamps with seven numbers each: position, then quaternion x, y, z, w."""
    ordered = sorted(rows, key=lambda row: row[0])
    values = np.array([row[1] for row in ordered], dtype=np.float64).reshape(-1, 7)
    return Trajectory(np.array([row[0] for row in ordered], dtype=np.int64), values[:, :3], values[:, 3:])


def load(path: Path) -> Trajectory:
    """Read a TUM file, or the ground truth of a sequence's folder (EuRoC, KITTI)."""
    return _truth_of(path) if path.is_dir() else _tum(path)


def save(path: Path, poses: Trajectory) -> None:
    """Write a TUM file."""
    values = np.hstack([poses.positions, poses.orientations])
    lines = [
        f"{tum_stamp(stamp)} {' '.join(f'{value:.9f}' for value in row)}\n"
        for stamp, row in zip(poses.stamps.tolist(), values, strict=True)
    ]
    path.write_text("".join(lines), encoding="utf-8")


def tum_stamp(stamp: int) -> str:
    """Seconds with all nine digits."""
    return f"{stamp // 1_000_000_000}.{stamp % 1_000_000_000:09d}"


def associate(first: Trajectory, second: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Poses of the same moments, as evo pairs them: for each of the shorter one, the nearest of the longer one.

    A pose without a partner within 0.01 s is left out, so one before or after the ground truth is.
    """
    if len(second) > len(first):
        shorter, longer = _nearest(first, second)
        return shorter, longer
    shorter, longer = _nearest(second, first)
    return longer, shorter


def _nearest(shorter: Trajectory, longer: Trajectory) -> tuple[Trajectory, Trajectory]:
    if not len(longer):
        return shorter, longer
    after = np.searchsorted(longer.stamps, shorter.stamps).clip(0, len(longer) - 1)
    before = (after - 1).clip(0)
    to_before, to_after = (np.abs(longer.stamps[index] - shorter.stamps) for index in (before, after))
    nearest = np.where(to_before <= to_after, before, after)
    together = np.flatnonzero(np.minimum(to_before, to_after) <= MAX_DIFFERENCE_NS)
    return shorter.at(together), longer.at(nearest[together])


def _truth_of(folder: Path) -> Trajectory:
    poses = truth(folder)
    return trajectory((pose.stamp, (*pose.position, *pose.orientation[1:], pose.orientation[0])) for pose in poses)


def _tum(path: Path) -> Trajectory:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    rows = [
        _row(line, f"{path}: line {number}")
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise TrajectoryError(f"{path}: there are no poses in it")
    return trajectory(rows)


def _row(line: str, place: str) -> tuple[int, list[float]]:
    """A line of a TUM file; a quaternion of zeros is as bad as a word."""
    try:
        stamp, *values = (Decimal(part) for part in line.replace(",", " ").split())
        numbers = [float(value) for value in values]
        if len(numbers) == 7 and np.isfinite(numbers).all() and any(numbers[3:]):
            return int(stamp * 1_000_000_000), numbers
    except (InvalidOperation, ValueError, OverflowError):
        pass
    raise TrajectoryError(f"{place}: invalid value {line[:100]!r}: expected seconds, x y z, and a quaternion x y z w")
