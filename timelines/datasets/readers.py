"""Reads recordings sample by sample: seconds from the start, and what is published then."""

from __future__ import annotations

import csv
import wave
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robotkit.stereo import StereoFrame, encode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Recorded: TypeAlias = tuple[float, bytes | dict[str, object]]

CHUNK_S = 0.1


class DatasetError(Exception):
    """A data set that is not there."""


def read(root: Path, name: str) -> Iterator[Recorded]:
    """Open `<recording>/<stream>` of a EuRoC sequence, or a folder with `audio.wav`."""
    folder, _, stream = name.rpartition("/")
    if (root / name / "audio.wav").is_file():
        return _audio(root / name / "audio.wav")
    if stream in _EUROC and (root / folder / "mav0").is_dir():
        return _EUROC[stream](root / folder / "mav0")
    raise DatasetError(f"data set {name} is not in {root}: make it with `python -m timelines.datasets`")


def euroc_rows(folder: Path) -> Iterator[tuple[int, list[str]]]:
    """Rows of a sensor's data.csv; stamps have 19 digits and stay integers, some copies have CRLF."""
    with (folder / "data.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.reader(file):
            if row and not row[0].startswith("#"):
                yield int(row[0]), [cell.strip() for cell in row[1:]]


def positions(mav0: Path, stamps: Sequence[int]) -> Floats:
    """Where the robot truly was at these stamps, N x 3 metres."""
    return _truth(mav0, stamps)[:, 0:3]


def _truth(mav0: Path, stamps: Sequence[int]) -> Floats:
    rows = list(euroc_rows(mav0 / "state_groundtruth_estimate0"))
    start = rows[0][0]  # seconds from here are small enough for a float
    known = np.array([stamp - start for stamp, _ in rows], dtype=np.float64)
    asked = np.array([stamp - start for stamp in stamps], dtype=np.float64)
    columns = np.array([[float(value) for value in values] for _, values in rows]).T
    return np.column_stack([np.interp(asked, known, column) for column in columns])


def _stereo(mav0: Path) -> Iterator[Recorded]:
    start = None
    for stamp, (file, *_) in euroc_rows(mav0 / "cam0"):
        right = mav0 / "cam1/data" / file
        if not right.is_file():  # real recordings lose a picture now and then
            continue
        start = stamp if start is None else start
        left = (mav0 / "cam0/data" / file).read_bytes()
        yield (stamp - start) / 1e9, encode(StereoFrame(stamp, left, right.read_bytes()))


def _imu(mav0: Path) -> Iterator[Recorded]:
    rows = list(euroc_rows(mav0 / "imu0"))
    stamps = [stamp for stamp, _ in rows]
    speeds = np.linalg.norm(_truth(mav0, stamps)[:, 7:10], axis=1)  # a wheel's odometry would tell it
    for (stamp, values), speed in zip(rows, speeds, strict=True):
        numbers = [float(value) for value in values]
        sample = {"gyro": numbers[:3], "accel": numbers[3:6], "speed": round(float(speed), 3)}
        yield (stamp - stamps[0]) / 1e9, sample


def _audio(path: Path) -> Iterator[Recorded]:
    """Chunks as a microphone delivers them: each when its last sample has been heard."""
    with wave.open(str(path)) as audio:
        frames = round(audio.getframerate() * CHUNK_S)
        for index in range(audio.getnframes() // frames):
            yield (index + 1) * CHUNK_S, audio.readframes(frames)


_EUROC: dict[str, Callable[[Path], Iterator[Recorded]]] = {"stereo": _stereo, "imu": _imu}
