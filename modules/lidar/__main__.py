"""`python -m modules.lidar`: scans from an RPLIDAR A1."""

import os
from pathlib import Path

from modules.lidar.task import build
from robotkit import main

main(Path(__file__).with_name("module.yaml"), lambda: build(os.environ))
