"""Reads sequences in the layout of KITTI's odometry benchmark.

    <sequence>/image_0/000000.png, image_1/000000.png, calib.txt, times.txt       as in dataset/sequences/00
    <sequence>/poses.txt, or ../../poses/00.txt                                   the left camera's true poses

Pictures are rectified. The colour pair is image_2 and image_3; extracts have image_l and image_r too. `calib.txt` has a
projection of 3 x 4 numbers a line, with a name (`P0:`) or without. Without times.txt there are ten pictures a second.
Format: Geiger, Lenz and Urtasun, "Are we ready for autonomous driving?" (CVPR 2012), and the benchmark's readme.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.calibration import Camera, Rig
from modules.slam.geometry import inverse, quaternion
from modules.slam.kalibr import BODY_FROM_CAMERA
from robotkit import euroc
from robotkit.stereo import StereoFrame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from modules.slam.geometry import Floats

PAIRS = {("image_0", "image_1"): (0, 1), ("image_2", "image_3"): (2, 3), ("image_l", "image_r"): (0, 1)}
"""Folders of both cameras, and the numbers of their projections."""
RATE_HZ = 10


def is_sequence(folder: Path) -> bool:
    """Whether a folder has this layout."""
    return (folder / "calib.txt").is_file() and _pair(folder) is not None


def stereo(folder: Path) -> Iterator[StereoFrame]:
    """Pairs of pictures; a left one without a right one is skipped."""
    for stamp, path, other in zip(_stamps(folder), *_pictures(folder), strict=True):
        if other.is_file():
            yield StereoFrame(stamp, path.read_bytes(), other.read_bytes())


def rig(folder: Path) -> Rig:
    """Both cameras; the body is the left one turned like a body, x forward, y left, z up."""
    names = _pair(folder)
    size = _size(_pictures(folder)[0][0])
    projections = _projections(folder / "calib.txt")
    left, right = (projections[number] for number in PAIRS[names or ("image_0", "image_1")])
    baseline = (left[0, 3] - right[0, 3]) / left[0, 0]
    beside = BODY_FROM_CAMERA.copy()
    beside[:3, 3] = BODY_FROM_CAMERA[:3, 0] * baseline
    cameras = ((left, BODY_FROM_CAMERA), (right, beside))
    return Rig(*(Camera(projection[:, :3], np.zeros(4), pose, size) for projection, pose in cameras))


def truth(folder: Path) -> list[euroc.TruePose] | None:
    """The body's true poses; None for a sequence without any."""
    path = next((path for path in _truths(folder) if path.is_file()), None)
    if path is None:
        return None
    rows, stamps = _rows(path, 12), _stamps(folder)
    if len(rows) != len(stamps):
        raise euroc.DatasetError(f"{path}: {len(rows)} poses, expected one for each of {len(stamps)} pictures")
    return [_pose(stamp, row) for stamp, row in zip(stamps, rows, strict=True)]


def _truths(folder: Path) -> tuple[Path, ...]:
    whole = folder.resolve()
    return folder / "poses.txt", whole.parent.parent / "poses" / f"{whole.name}.txt"


def _pose(stamp: int, row: Floats) -> euroc.TruePose:
    pose = np.vstack([row.reshape(3, 4), [0, 0, 0, 1]])
    body = BODY_FROM_CAMERA @ pose @ inverse(BODY_FROM_CAMERA)
    x, y, z, w = quaternion(body[:3, :3])
    return euroc.TruePose(stamp, tuple(body[:3, 3].tolist()), (w, x, y, z), None)


def _pair(folder: Path) -> tuple[str, str] | None:
    return next((pair for pair in PAIRS if all((folder / name).is_dir() for name in pair)), None)


def _pictures(folder: Path) -> tuple[list[Path], list[Path]]:
    left, right = _pair(folder) or ("image_0", "image_1")
    paths = sorted((folder / left).glob("*.png"))
    if not paths:
        raise euroc.DatasetError(f"{folder / left}: no pictures, expected 000000.png and so on")
    return paths, [folder / right / path.name for path in paths]


def _size(path: Path) -> tuple[int, int]:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise euroc.DatasetError(f"{path}: cannot be decoded, expected a PNG")
    return picture.shape[1], picture.shape[0]


def _stamps(folder: Path) -> list[int]:
    """A stamp for each picture, in ns since the sequence's start."""
    count, path = len(_pictures(folder)[0]), folder / "times.txt"
    times = [row[0] for row in _rows(path, 1)] if path.is_file() else [number / RATE_HZ for number in range(count)]
    if len(times) < count:
        raise euroc.DatasetError(f"{path}: {len(times)} times, expected one for each of {count} pictures")
    return [round(time * 1e9) for time in times[:count]]


def _projections(path: Path) -> dict[int, Floats]:
    """By number, whether named or in their order."""
    rows = _rows(path, 12)
    if len(rows) < 2 or min(row[0] for row in rows) <= 0:
        raise euroc.DatasetError(f"{path}: {len(rows)} projections, expected two or more with a focal length above 0")
    return {number: row.reshape(3, 4) for number, row in enumerate(rows)}


def _rows(path: Path, count: int) -> list[Floats]:
    """Lines of so many numbers; a name in front of them is left out, and so is the pose of the laser scanner (`Tr`)."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise euroc.DatasetError(f"{path}: cannot be read: {error}") from error
    kept = [line for line in lines if line.strip() and not line.startswith(("#", "Tr"))]
    return [_numbers(line, count, path) for line in kept]


def _numbers(line: str, count: int, path: Path) -> Floats:
    try:
        values = np.array(line.rpartition(":")[2].split(), dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise euroc.DatasetError(f"{path}: invalid line {line[:60]!r}: expected {count} numbers")
    return values
