"""`python -m modules.slam`: poses from stereo frames; RIG_DIR may name the calibration of other cameras."""

import os
from pathlib import Path

import cv2

from modules.slam.calibration import Rectifier, load_rig
from modules.slam.slam import StereoSlam
from modules.slam.task import Slam
from robotkit import main

HERE = Path(__file__).parent


def build() -> Slam:
    """Make the task with the cameras of this robot."""
    cv2.setNumThreads(1)  # its share is what the policy gives, not all cores
    return Slam(StereoSlam(Rectifier(load_rig(Path(os.environ.get("RIG_DIR", HERE / "rig"))))))


main(HERE / "module.yaml", build)
