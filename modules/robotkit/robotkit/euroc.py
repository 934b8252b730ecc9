"""Reads sequences in the EuRoC MAV format (ASL), as found in the wild.

    <sequence>/mav0/cam0/data.csv, cam0/data/<ns>.png, cam1/..., imu0/data.csv, state_groundtruth_estimate0/data.csv

Stamps have 19 digits and stay integers. Files may have CRLF, a byte order mark, comments and blank lines; an archive
may unpack to a bare `mav0`; a picture may be missing. Ground truth has 17 columns, or 8 without velocity (TUM-VI).
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from robotkit.errors import ConfigurationError
from robotkit.readings import ImuSample
from robotkit.stereo import StereoFrame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TRUTH = "state_groundtruth_estimate0"


class DatasetError(ConfigurationError):
    """A data set that is missing or has an invalid row."""


class Row(NamedTuple):
    """A line of a data.csv."""

    stamp: int
    cells: list[str]


@dataclass(frozen=True, slots=True)
class TruePose:
    """The body's true pose: metres, a quaternion (w, x, y, z), m/s; `velocity` is None where the file has none."""

    stamp: int
    position: tuple[float, ...]
    orientation: tuple[float, ...]
    velocity: tuple[float, ...] | None


def find(folder: Path) -> Path:
    """The folder with the sensors: `folder/mav0`, or `folder` itself."""
    for place in (folder / "mav0", folder):
        if (place / "cam0/data.csv").is_file() or (place / "imu0/data.csv").is_file():
            return place
    raise DatasetError(f"{folder}: no EuRoC sequence: neither mav0/cam0/data.csv nor mav0/imu0/data.csv is there")


def rows(sensor: Path) -> Iterator[Row]:
    """The rows of a sensor's data.csv."""
    path = sensor / "data.csv"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for number, cells in enumerate(csv.reader(file), start=1):
                if any(cells) and not cells[0].lstrip().startswith("#"):
                    yield Row(_stamp(cells[0], path, number), [cell.strip() for cell in cells[1:]])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{path}: cannot be read: {error}") from error


def stereo(mav0: Path) -> Iterator[StereoFrame]:
    """Pairs of pictures; a left one without a right one is skipped."""
    for stamp, cells in rows(mav0 / "cam0"):
        name = cells[0] if cells and cells[0] else f"{stamp}.png"
        left, right = (mav0 / camera / "data" / name for camera in ("cam0", "cam1"))
        if left.is_file() and right.is_file():
            yield StereoFrame(stamp, left.read_bytes(), right.read_bytes())


def pictures(mav0: Path, camera: str) -> Iterator[tuple[int, bytes]]:
    """Stamps and pictures of one camera, such as cam0."""
    for stamp, cells in rows(mav0 / camera):
        path = mav0 / camera / "data" / (cells[0] if cells and cells[0] else f"{stamp}.png")
        if path.is_file():
            yield stamp, path.read_bytes()


def imu(mav0: Path) -> Iterator[ImuSample]:
    """Samples of imu0; the file has rates first, then accelerations."""
    for row in rows(mav0 / "imu0"):
        wx, wy, wz, ax, ay, az = _numbers(row, 6, mav0 / "imu0/data.csv")
        yield ImuSample(row.stamp, (wx, wy, wz), (ax, ay, az))


def truth(mav0: Path) -> list[TruePose] | None:
    """The ground truth; None for a sequence without any."""
    folder = mav0 / TRUTH
    return [_pose(row, folder / "data.csv") for row in rows(folder)] if folder.is_dir() else None


def speeds(poses: list[TruePose]) -> list[float]:
    """Speed at each pose in m/s, derived from the positions where the file has no velocity."""
    return [
        math.dist(pose.velocity, (0, 0, 0)) if pose.velocity else _difference(poses, index)
        for index, pose in enumerate(poses)
    ]


def _difference(poses: list[TruePose], index: int) -> float:
    before, after = poses[max(index - 1, 0)], poses[min(index + 1, len(poses) - 1)]
    seconds = (after.stamp - before.stamp) / 1e9
    return math.dist(before.position, after.position) / seconds if seconds > 0 else 0.0


def _pose(row: Row, path: Path) -> TruePose:
    values = _numbers(row, 10 if len(row.cells) >= 10 else 7, path)
    return TruePose(row.stamp, tuple(values[:3]), tuple(values[3:7]), tuple(values[7:10]) or None)


def _numbers(row: Row, count: int, path: Path) -> list[float]:
    try:
        values = [float(cell) for cell in row.cells[:count]]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise DatasetError(
            f"{path}: row {row.stamp}: invalid value {','.join(row.cells)[:100]!r}: expected {count} numbers"
        )
    return values


def _stamp(cell: str, path: Path, number: int) -> int:
    try:
        return int(cell)
    except ValueError:
        raise DatasetError(f"{path}: line {number}: invalid value {cell[:40]!r}: expected a time in ns") from None
