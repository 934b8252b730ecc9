"""Where things are on this side, and where they are inside the machine."""

from __future__ import annotations

from pathlib import Path

from tests.node.layout import CACHE, REPOSITORY

BUILD = REPOSITORY / "build" / "vm"
CONSOLE = BUILD / "console.log"
DISK = BUILD / "disk.img"
LOGS = BUILD / "logs"
SYSTEMS = CACHE / "vm"

INSIDE = Path("/srv/contextpolicy")
INSIDE_REPOSITORY = INSIDE / "repository"
INSIDE_PACKAGES = INSIDE / "packages"
INSIDE_CHART = INSIDE / "chart.json"
INSIDE_LOGS = Path("/var/log/contextpolicy-vm")
TESTS_VARIABLE = "CONTEXTPOLICY_VM_TESTS"
