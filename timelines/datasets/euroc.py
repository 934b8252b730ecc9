"""Writes a EuRoC sequence (cam0, cam1, imu0, ground truth) of a robot that moves through a generated building."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam import calibration, geometry
from timelines.datasets import corridor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from modules.slam.calibration import Camera
    from timelines.datasets.motion import Floats, Motion

RIG = Path(calibration.__file__).parent / "rig"
EPOCH_NS = 1_403_636_579_000_000_000
IMU_RATE = 200
PIXEL_NOISE = 1.5
BEYOND = 5
"""Metres from where the robot ends to the corridor's far wall."""
GYRO_NOISE, GYRO_WALK = 1.6968e-04, 1.9393e-05
ACCEL_NOISE, ACCEL_WALK = 2.0e-3, 3.0e-3
IMU_HEADER = "#timestamp [ns]," + ",".join(
    [*(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz")]
)
TRUTH_HEADER = "#timestamp," + ",".join(
    [
        *(f" p_RS_R_{axis} [m]" for axis in "xyz"),
        *(f" q_RS_{axis} []" for axis in "wxyz"),
        *(f" v_RS_R_{axis} [m s^-1]" for axis in "xyz"),
        *(f" b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
        *(f" b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
    ]
)
IMU_SENSOR = f"""sensor_type: imu
comment: generated with the noise of an ADIS16448
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: {IMU_RATE}
gyroscope_noise_density: {GYRO_NOISE}
gyroscope_random_walk: {GYRO_WALK}
accelerometer_noise_density: {ACCEL_NOISE}
accelerometer_random_walk: {ACCEL_WALK}
"""
TRUTH_SENSOR = "sensor_type: visual-inertial\ncomment: generated, exact\n"


@dataclass(frozen=True)
class Sequence:
    """What to record: the motion, the cameras' frame rate in Hz, the seed of walls and noise, and the hall.

    Without a hall it is a corridor, as long as the path needs.
    """

    motion: Motion
    camera_rate: float = 10
    seed: int = 7
    hall: corridor.Hall | None = None


def write(folder: Path, sequence: Sequence, progress: Callable[[float], None]) -> None:
    """Write `mav0` into the folder."""
    write_inertial(folder, sequence)
    _write_cameras(folder / "mav0", sequence, progress)


def write_inertial(folder: Path, sequence: Sequence) -> None:
    """Write `mav0` without pictures: the IMU and the ground truth."""
    bias = _write_imu(folder / "mav0/imu0", sequence)
    _write_truth(folder / "mav0/state_groundtruth_estimate0", sequence.motion, bias)


def _times(duration: float, rate: float) -> Floats:
    times: Floats = np.arange(round(duration * rate)) / rate
    return times


def _stamps(times: Floats) -> list[int]:
    return [EPOCH_NS + round(time * 1e9) for time in times]


def _write_csv(folder: Path, header: str, stamps: list[int], values: Floats) -> None:
    lines = [f"{stamp}," + ",".join(f"{value:.9g}" for value in row) for stamp, row in zip(stamps, values, strict=True)]
    folder.mkdir(parents=True)
    (folder / "data.csv").write_text("\n".join([header, *lines, ""]), encoding="utf-8")


def _write_imu(folder: Path, sequence: Sequence) -> Floats:
    """Write noisy samples; return the biases that were added, N x 6."""
    motion, rng = sequence.motion, np.random.default_rng(sequence.seed)
    times = _times(motion.duration, IMU_RATE)
    exact = np.hstack([motion.gyro_at(times), motion.accelerations_at(times)])
    noise = np.repeat([GYRO_NOISE, ACCEL_NOISE], 3) * np.sqrt(IMU_RATE)
    walk = np.repeat([GYRO_WALK, ACCEL_WALK], 3) / np.sqrt(IMU_RATE)
    bias: Floats = np.cumsum(rng.normal(0, walk, exact.shape), axis=0)
    _write_csv(folder, IMU_HEADER, _stamps(times), exact + bias + rng.normal(0, noise, exact.shape))
    (folder / "sensor.yaml").write_text(IMU_SENSOR, encoding="utf-8")
    return bias


def _write_truth(folder: Path, motion: Motion, bias: Floats) -> None:
    times = _times(motion.duration, IMU_RATE)
    turns = np.roll([geometry.quaternion(rotation) for rotation in motion.rotations_at(times)], 1, axis=1)
    values = np.hstack([motion.positions_at(times), turns, motion.velocities_at(times), bias])
    _write_csv(folder, TRUTH_HEADER, _stamps(times), values)
    (folder / "sensor.yaml").write_text(TRUTH_SENSOR, encoding="utf-8")


def _write_cameras(mav0: Path, sequence: Sequence, progress: Callable[[float], None]) -> None:
    motion = sequence.motion
    times = _times(motion.duration, sequence.camera_rate)
    hall = sequence.hall or corridor.corridor(float(motion.positions_at(times)[:, 0].max()) + BEYOND)
    walls = corridor.build(hall, seed=sequence.seed)
    for index, name in enumerate(("cam0", "cam1")):
        folder = mav0 / name
        (folder / "data").mkdir(parents=True)
        shutil.copy(RIG / name / "sensor.yaml", folder)
        _write_index(folder, _stamps(times))
        _write_pictures(folder, sequence, walls, _half(progress, index))


def _half(progress: Callable[[float], None], index: int) -> Callable[[float], None]:
    return lambda share: progress((index + share) / 2)


def _write_index(folder: Path, stamps: list[int]) -> None:
    lines = [f"{stamp},{stamp}.png" for stamp in stamps]
    (folder / "data.csv").write_text("\n".join(["#timestamp [ns],filename", *lines, ""]), encoding="utf-8")


def _write_pictures(folder: Path, sequence: Sequence, walls: corridor.Walls, progress: Callable[[float], None]) -> None:
    camera = calibration.load_camera(folder / "sensor.yaml")
    times = _times(sequence.motion.duration, sequence.camera_rate)
    poses = _camera_poses(sequence.motion, times, camera)
    look = _Viewer(walls, camera)
    rng = np.random.default_rng((sequence.seed, int(folder.name.removeprefix("cam"))))
    for index, (stamp, pose) in enumerate(zip(_stamps(times), poses, strict=True)):
        noisy = look(pose) + rng.normal(0, PIXEL_NOISE, camera.size[::-1]).astype(np.float32)
        cv2.imwrite(str(folder / "data" / f"{stamp}.png"), np.clip(noisy, 0, 255).astype(np.uint8))
        progress((index + 1) / len(times))


def _camera_poses(motion: Motion, times: Floats, camera: Camera) -> list[Floats]:
    bodies = zip(motion.rotations_at(times), motion.positions_at(times), strict=True)
    return [geometry.transform(*body) @ camera.body_from_camera for body in bodies]


class _Viewer:
    """Draws what a camera sees; the view is redrawn only when the camera has moved."""

    def __init__(self, walls: corridor.Walls, camera: Camera) -> None:
        self._walls = walls
        self._size = camera.size
        self._rays = corridor.rays(camera)
        self._last: tuple[Floats, NDArray[np.uint8]] | None = None

    def __call__(self, pose: Floats) -> NDArray[np.uint8]:
        if self._last is None or not np.array_equal(self._last[0], pose):
            turned = pose[:3, :3].astype(np.float32) @ self._rays
            place = pose[:3, 3].astype(np.float32)
            self._last = (pose, corridor.picture(self._walls, turned, place, self._size))
        return self._last[1]
