"""`python -m modules.camera`: pictures from CAMERA_SOURCE."""

import os
from pathlib import Path

import cv2

from modules.camera.sources import VIEWS, Devices, Recorded, Source
from modules.camera.task import Camera
from robotkit import ConfigurationError, main


def build() -> Camera:
    """Make the task that the environment describes."""
    cv2.setNumThreads(1)  # its share is what the policy gives, not all cores
    name, view = os.environ.get("CAMERA_SOURCE", ""), os.environ.get("CAMERA_VIEW", "stereo")
    if view not in VIEWS:
        raise ConfigurationError(f"CAMERA_VIEW: invalid value {view!r}: expected {', '.join(VIEWS)}")
    if not name:
        raise ConfigurationError("CAMERA_SOURCE is empty: a folder of a EuRoC sequence, or devices such as /dev/video0")
    if name.startswith("/dev/"):
        paths = name.split(",")
        source: Source = Devices(paths)
        return Camera(source, output="stereo" if len(paths) == 2 else "picture", rate=_rate())
    return Camera(Recorded(Path(name), view), output="stereo" if view == "stereo" else "picture", rate=_rate())


def _rate() -> float | None:
    text = os.environ.get("CAMERA_RATE", "")
    try:
        rate = float(text) if text else None
    except ValueError:
        rate = 0.0
    if rate is not None and not 0 < rate <= 1000:
        raise ConfigurationError(
            f"CAMERA_RATE: invalid value {text!r}: expected frames per second, above 0 and at most 1000"
        )
    return rate


main(Path(__file__).with_name("module.yaml"), build)
