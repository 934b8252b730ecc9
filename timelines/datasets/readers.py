"""Reads recordings sample by sample: seconds from the start, and what is published then."""

from __future__ import annotations

import csv
import re
import wave
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from contextpolicy.streams.recordings import Excerpt, open_recording
from robotkit import euroc
from robotkit.euroc import DatasetError
from robotkit.stereo import encode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Recorded: TypeAlias = tuple[float, bytes | dict[str, object]]

CHUNK_S = 0.1
MESSAGES = "messages.mcap"
"""The recording of a robot in a data set's folder."""


def read(root: Path, name: str) -> Iterator[Recorded]:
    """Open `<recording>/<stream>` of a EuRoC sequence, sound, pictures, or messages of a robot's recording."""
    folder, _, stream = name.rpartition("/")
    if (root / name / "audio.wav").is_file():
        return _audio(root / name / "audio.wav")
    if (root / name / "data.csv").is_file():
        return _pictures(root / name)
    if stream in _EUROC and (root / folder / "mav0").is_dir():
        return _EUROC[stream](root / folder / "mav0")
    if (root / folder / MESSAGES).exists():
        return _messages(root / folder / MESSAGES, stream)
    raise DatasetError(f"data set {name} is not in {root}: make it with `python -m timelines.datasets`")


def _true_speeds(poses: list[euroc.TruePose], stamps: Sequence[int]) -> Floats:
    """Metres per second at these stamps; NaN before and after the ground truth."""
    start = poses[0].stamp  # seconds from here are small enough for a float
    known = np.array([pose.stamp - start for pose in poses], dtype=np.float64)
    asked = np.array([stamp - start for stamp in stamps], dtype=np.float64)
    return np.interp(asked, known, euroc.speeds(poses), left=np.nan, right=np.nan)


def _stereo(mav0: Path) -> Iterator[Recorded]:
    start = None
    for frame in euroc.stereo(mav0):
        start = frame.stamp if start is None else start
        yield (frame.stamp - start) / 1e9, encode(frame)


def _imu(mav0: Path) -> Iterator[Recorded]:
    """Samples, with the true speed (as wheel odometry would report it) where the sequence has ground truth."""
    samples, poses = list(euroc.imu(mav0)), euroc.truth(mav0)
    stamps = [sample.stamp for sample in samples]
    speeds = _true_speeds(poses, stamps) if poses else None
    for index, sample in enumerate(samples):
        known = {} if speeds is None or np.isnan(speeds[index]) else {"speed": round(float(speeds[index]), 3)}
        yield (sample.stamp - stamps[0]) / 1e9, {"gyro": list(sample.gyro), "accel": list(sample.accel), **known}


def _audio(path: Path) -> Iterator[Recorded]:
    """Chunks as a microphone delivers them: each at the time of its last sample."""
    with wave.open(str(path)) as audio:
        frames = round(audio.getframerate() * CHUNK_S)
        for index in range(audio.getnframes() // frames):
            yield (index + 1) * CHUNK_S, audio.readframes(frames)


def stream_of(topic: str) -> str:
    """The name of a recorded topic as a data set's stream."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", topic.strip("/"))


def _messages(path: Path, stream: str) -> Iterator[Recorded]:
    recording = open_recording(path, Excerpt())
    topics = [topic for topic in recording.topics if stream_of(topic) == stream]
    if not topics:
        raise DatasetError(f"{path} has no topic {stream}: it has {', '.join(map(stream_of, recording.topics))}")
    for message in recording.messages(topics, recording.begin, recording.end):
        yield (message.at - recording.begin) / 1e9, message.payload


def _pictures(folder: Path) -> Iterator[Recorded]:
    with (folder / "data.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.reader(file):
            if row and not row[0].startswith("#"):
                yield float(row[0]), (folder / "data" / row[1]).read_bytes()


_EUROC: dict[str, Callable[[Path], Iterator[Recorded]]] = {"stereo": _stereo, "imu": _imu}
