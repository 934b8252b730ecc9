"""`python -m modules.slam`: poses from stereo frames; RIG_DIR may name the calibration of other cameras."""

import os
from pathlib import Path

import cv2

from modules.robotkit.task import load_task, main
from modules.slam.calibration import Rectifier, load_rig
from modules.slam.odometry import Odometry
from modules.slam.task import Slam

cv2.setNumThreads(1)  # its share is what the policy gives, not all cores
HERE = Path(__file__).parent
slam = Slam(Odometry(Rectifier(load_rig(Path(os.environ.get("RIG_DIR", HERE / "rig"))))))
main(load_task(HERE / "module.yaml"), slam.process, slam.adapt)
