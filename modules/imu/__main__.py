"""`python -m modules.imu`: motion from samples of the bus, or of the sequence in IMU_SOURCE."""

import os
from pathlib import Path

from modules.imu.task import Imu
from robotkit import main

source = os.environ.get("IMU_SOURCE", "")
main(Path(__file__).with_name("module.yaml"), lambda: Imu(Path(source) if source else None))
