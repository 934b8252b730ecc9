"""Stereo calibration from EuRoC's sensor.yaml files or Kalibr's camchain, and the rectification that follows from it.

Two lens models: radial-tangential, and equidistant (Kannala-Brandt, which OpenCV calls fisheye).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np
import yaml

from modules.slam import kalibr
from modules.slam.geometry import floats
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from modules.slam.geometry import Floats, Image

    Read = TypeVar("Read")


@dataclass(frozen=True)
class Camera:
    """One camera: how it projects and where it sits on the robot's body."""

    matrix: Floats
    distortion: Floats
    body_from_camera: Floats
    size: tuple[int, int]
    fisheye: bool = False


@dataclass(frozen=True)
class Rig:
    """Two cameras that look the same way."""

    left: Camera
    right: Camera


LENSES = {"radial-tangential": False, "equidistant": True}
"""Whether OpenCV calls a lens a fisheye."""


class CalibrationError(ConfigurationError):
    """A calibration that is missing, or is not a pair of pinhole cameras in a format and with a lens that is known."""


def load_rig(folder: Path) -> Rig:
    """Read `cam0` and `cam1` of a folder, as in the mav0 folder of a EuRoC sequence, or its Kalibr camchain*.yaml."""
    chains = sorted(folder.glob("*camchain*.yaml"))
    if not chains:
        return Rig(load_camera(folder / "cam0/sensor.yaml"), load_camera(folder / "cam1/sensor.yaml"))
    return _load(chains[0], lambda document: Rig(*map(_camera, kalibr.as_sensors(document))))


def load_camera(path: Path) -> Camera:
    """Read one sensor.yaml."""
    return _load(path, _camera)


def _load(path: Path, read: Callable[[dict[str, Any]], Read]) -> Read:
    """Read YAML; some copies start with a byte order mark, or with OpenCV's %YAML:1.0, which is not YAML."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        return read(yaml.safe_load("\n".join(line for line in lines if not line.startswith("%YAML:"))))
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f"{path}: not a valid calibration: {error}") from error


def _camera(document: dict[str, Any]) -> Camera:
    model, lens = document["camera_model"], document["distortion_model"]
    if model != "pinhole" or lens not in LENSES:
        raise ValueError(f"invalid model {model} with {lens} distortion: expected pinhole with {' or '.join(LENSES)}")
    fu, fv, cu, cv = _numbers(document, "intrinsics", 4)
    width, height = _numbers(document, "resolution", 2)
    if min(fu, fv, width, height) <= 0:
        raise ValueError(f"invalid intrinsics {fu, fv, cu, cv} of {width:g} x {height:g} pixels: expected above 0")
    return Camera(
        matrix=np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]),
        distortion=_numbers(document, "distortion_coefficients", 4),
        body_from_camera=_numbers(document["T_BS"], "data", 16).reshape(4, 4),
        size=(int(width), int(height)),
        fisheye=LENSES[lens],
    )


def _numbers(document: dict[str, Any], field: str, count: int) -> Floats:
    values = np.array(document[field], dtype=np.float64)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{field}: invalid value {document[field]}: expected {count} numbers")
    return values


class Rectifier:
    """Turns both images so that a point has the same row in both, and rows have no distortion."""

    def __init__(self, rig: Rig) -> None:
        right_from_left = np.linalg.inv(rig.right.body_from_camera) @ rig.left.body_from_camera
        left, right = rig.left, rig.right
        self.size = left.size
        turn_left, turn_right, left_projection, right_projection = _rectification(left, right, right_from_left)
        self.matrix: Floats = left_projection[:, :3]
        self.baseline = float(-right_projection[0, 3] / right_projection[0, 0])
        self.body_from_camera: Floats = left.body_from_camera.copy()
        self.body_from_camera[:3, :3] = left.body_from_camera[:3, :3] @ turn_left.T
        self._left_maps = _maps(left, turn_left, left_projection)
        self._right_maps = _maps(right, turn_right, right_projection)

    def left(self, image: Image) -> Image:
        """Rectify a left image."""
        return _remap(image, self._left_maps)

    def right(self, image: Image) -> Image:
        """Rectify a right image."""
        return _remap(image, self._right_maps)

    def in_space(self, pixels: Floats, disparities: Floats) -> Floats:
        """Places in the left camera's frame, N x 3 metres, of rectified pixels with these disparities."""
        rays = np.column_stack([(pixels - self.matrix[:2, 2]) / self.matrix[0, 0], np.ones(len(pixels))])
        points: Floats = rays * (self.matrix[0, 0] * self.baseline / disparities)[:, None]
        return points


def _rectification(left: Camera, right: Camera, right_from_left: Floats) -> tuple[Floats, ...]:
    """Rotations of both cameras, and their projections afterwards."""
    if left.fisheye != right.fisheye or left.size != right.size:
        raise CalibrationError("cam0 and cam1 differ in lens or resolution: expected a pair of equal cameras")
    across, down, ahead = np.linalg.inv(right_from_left)[:3, 3]
    if across <= max(abs(down), abs(ahead)):
        raise CalibrationError(
            f"cam1 is {across:.3g} m to the right of cam0, {down:.3g} m below and {ahead:.3g} m ahead of it; "
            "expected it mainly to the right of cam0"
        )
    intrinsics = (left.matrix, left.distortion, right.matrix, right.distortion, left.size)
    turn, shift = right_from_left[:3, :3].copy(), right_from_left[:3, 3:].copy()  # OpenCV wants them in one piece
    if left.fisheye:
        fisheyes = cv2.fisheye.stereoRectify(*intrinsics, turn, shift, cv2.CALIB_ZERO_DISPARITY, balance=0.0)
        return tuple(map(floats, fisheyes[:4]))
    return tuple(map(floats, cv2.stereoRectify(*intrinsics, turn, shift, alpha=0)[:4]))


def _maps(camera: Camera, turn: Floats, projection: Floats) -> tuple[NDArray[Any], NDArray[Any]] | None:
    """Which pixel each one is taken from, and the fraction of a pixel beside it; None if all stay where they are.

    Pictures that are rectified already are then not resampled, which costs time.
    """
    undistort = cv2.fisheye.initUndistortRectifyMap if camera.fisheye else cv2.initUndistortRectifyMap
    first, second = undistort(camera.matrix, camera.distortion, turn, projection, camera.size, cv2.CV_16SC2)
    stay = np.dstack(np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1])))
    return None if not second.any() and np.array_equal(first, stay) else (first, second)


def _remap(image: Image, maps: tuple[NDArray[Any], NDArray[Any]] | None) -> Image:
    if maps is None:
        return image
    return cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR).astype(np.uint8, copy=False)
