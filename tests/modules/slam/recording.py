"""Generated pictures for the tests of SLAM: a few seconds of corridor, and the cached recording with loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.calibration import Rectifier, load_rig
from modules.slam.slam import StereoSlam
from robotkit import euroc
from timelines.datasets import euroc as generator

if TYPE_CHECKING:
    from pathlib import Path

BLACK = np.zeros((480, 752), np.uint8)


def slam() -> StereoSlam:
    return StereoSlam(Rectifier(load_rig(generator.RIG)))


def pictures(folder: Path):
    """Stamps, and pairs of pictures."""
    for frame in euroc.stereo(folder / "mav0"):
        yield (
            frame.stamp,
            *(
                cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_GRAYSCALE)
                for encoded in (frame.left, frame.right)
            ),
        )


def track(module: StereoSlam, left, right):
    return module.track(left, lambda: right)
