"""`python -m modules.arm`: moves a MeArm."""

import os
from pathlib import Path

from modules.arm.joints import load_arm
from modules.arm.task import PORT, MeArm
from robotkit import main

HERE = Path(__file__).parent


def build() -> MeArm:
    """Read the environment."""
    path = Path(os.environ.get("ARM_CONFIG", HERE / "arm.yaml"))
    return MeArm(load_arm(path), os.environ.get("SERIAL_PORT", PORT))


main(HERE / "module.yaml", build)
