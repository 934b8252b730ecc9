"""`python -m modules.host`: the node's temperature, frequency, pressure, memory and battery."""

import os
from pathlib import Path

from modules.host.sensors import Host
from modules.host.task import HostSensors
from robotkit import main

main(Path(__file__).with_name("module.yaml"), lambda: HostSensors(Host(Path(os.environ.get("HOST_ROOT", "/")))))
