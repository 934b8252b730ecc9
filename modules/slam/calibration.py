"""Stereo calibration from EuRoC's sensor.yaml files, and the rectification that follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import yaml

from modules.slam.geometry import floats
from robotkit import ConfigurationError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from modules.slam.geometry import Floats, Image


@dataclass(frozen=True)
class Camera:
    """One camera: how it projects and where it sits on the robot's body."""

    matrix: Floats
    distortion: Floats
    body_from_camera: Floats
    size: tuple[int, int]


@dataclass(frozen=True)
class Rig:
    """Two cameras that look the same way."""

    left: Camera
    right: Camera


class CalibrationError(ConfigurationError):
    """A sensor.yaml that is missing or is not a pinhole camera of EuRoC's format."""


def load_rig(folder: Path) -> Rig:
    """Read `cam0` and `cam1` of a folder, as in the mav0 folder of a EuRoC sequence."""
    return Rig(load_camera(folder / "cam0/sensor.yaml"), load_camera(folder / "cam1/sensor.yaml"))


def load_camera(path: Path) -> Camera:
    """Read one sensor.yaml; some copies start with OpenCV's %YAML:1.0, which is not YAML."""
    try:
        text = path.read_text(encoding="utf-8").removeprefix("%YAML:1.0")
        return _camera(yaml.safe_load(text))
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: not a EuRoC camera: {error}") from error


def _camera(document: dict[str, Any]) -> Camera:
    if (document["camera_model"], document["distortion_model"]) != ("pinhole", "radial-tangential"):
        raise ValueError("only pinhole cameras with radial-tangential distortion")
    fu, fv, cu, cv = document["intrinsics"]
    width, height = document["resolution"]
    return Camera(
        matrix=np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]], dtype=np.float64),
        distortion=np.array(document["distortion_coefficients"], dtype=np.float64),
        body_from_camera=np.array(document["T_BS"]["data"], dtype=np.float64).reshape(4, 4),
        size=(width, height),
    )


class Rectifier:
    """Turns both images so that a point has the same row in both, and rows have no distortion."""

    def __init__(self, rig: Rig) -> None:
        right_from_left = np.linalg.inv(rig.right.body_from_camera) @ rig.left.body_from_camera
        left, right = rig.left, rig.right
        rectification = cv2.stereoRectify(
            left.matrix,
            left.distortion,
            right.matrix,
            right.distortion,
            left.size,
            right_from_left[:3, :3],
            right_from_left[:3, 3:],
            alpha=0,
        )
        turn_left, turn_right, left_projection, right_projection = map(floats, rectification[:4])
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


def _maps(camera: Camera, turn: Floats, projection: Floats) -> tuple[NDArray[Any], NDArray[Any]]:
    first, second = cv2.initUndistortRectifyMap(
        camera.matrix, camera.distortion, turn, projection, camera.size, cv2.CV_16SC2
    )
    return first, second


def _remap(image: Image, maps: tuple[NDArray[Any], NDArray[Any]]) -> Image:
    return cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR).astype(np.uint8, copy=False)
