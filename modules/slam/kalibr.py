"""Stereo calibration as Kalibr writes it: a camchain.yaml (or camchain-imucam.yaml) with cam0 and cam1.

`T_cn_cnm1` is the right camera from the left one. The body is the IMU where the file knows it (`T_cam_imu`), else the
left camera turned like a body: x forward, y left, z up. Format: the Kalibr wiki, "yaml formats".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from modules.slam.geometry import floats

if TYPE_CHECKING:
    from modules.slam.geometry import Floats

BODY_FROM_CAMERA = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
MODELS = {"radtan": "radial-tangential", "equidistant": "equidistant"}


def as_sensors(chain: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Both cameras as documents in EuRoC's format; KeyError, TypeError or ValueError for anything but a camchain."""
    left, right = chain["cam0"], chain["cam1"]
    known = "T_cam_imu" in left
    body_from_left = floats(np.linalg.inv(_matrix(left["T_cam_imu"]))) if known else BODY_FROM_CAMERA
    body_from_right = floats(body_from_left @ np.linalg.inv(_matrix(right["T_cn_cnm1"])))
    return _sensor(left, body_from_left), _sensor(right, body_from_right)


def _sensor(camera: dict[str, Any], body_from_camera: Floats) -> dict[str, Any]:
    model = camera["distortion_model"]
    if model not in MODELS:
        raise ValueError(f"distortion_model: invalid value {model!r}: expected {', '.join(MODELS)}")
    return {
        "camera_model": camera["camera_model"],
        "intrinsics": camera["intrinsics"],
        "resolution": camera["resolution"],
        "distortion_model": MODELS[model],
        "distortion_coefficients": camera["distortion_coeffs"],
        "T_BS": {"data": body_from_camera.ravel().tolist()},
    }


def _matrix(rows: Any) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(4, 4)
