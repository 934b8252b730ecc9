"""`python -m modules.navigation`: drives an iRobot Create 2; SERIAL_PORT is its guard, or the robot itself."""

import os
from pathlib import Path

from modules.navigation.guard import ADDRESS
from modules.navigation.task import Navigation
from robotkit import main

main(Path(__file__).with_name("module.yaml"), lambda: Navigation(os.environ.get("SERIAL_PORT", ADDRESS)))
