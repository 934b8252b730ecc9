"""Runs inside the machine, as its services: starts the node; then runs the tests, around one reboot."""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import sys

from tests.node import lifecycle
from tests.node.layout import BIN, REPOSITORY
from tests.node.layout import LOGS as NODE_LOGS
from tests.vm.places import INSIDE_LOGS

log = logging.getLogger(__name__)

STAGES = {"running": ("test_systemd.py", "test_running.py"), "rebooted": ("test_rebooted.py",)}
"""What runs before the machine is rebooted, and what after."""
TESTS = REPOSITORY / "tests" / "vm" / "inside"


def start_node() -> None:
    """Start the node; nothing has to be built, for everything is on the disk."""
    lifecycle.boot()


def run_tests() -> None:
    """Run the tests of the stage that comes next; then reboot, or power off after the last."""
    stage = next(stage for stage in STAGES if not (INSIDE_LOGS / stage).exists())
    verdict = INSIDE_LOGS / stage
    verdict.write_text("unknown: it did not end")
    try:
        verdict.write_text(str(_pytest(stage)))
    finally:
        _keep_logs(stage)
        last = stage == list(STAGES)[-1]
        subprocess.run(["systemctl", "poweroff" if last else "reboot"], check=True, timeout=300)


def _pytest(stage: str) -> int:
    options = ["-v", "-p", "no:cacheprovider", "-o", "faulthandler_timeout=0", "--maxfail=3", "--durations=0"]
    inside = [sys.executable, "-m", "tests.node", "exec", "--"]
    pytest = [sys.executable, "-m", "pytest", *options, *(str(TESTS / name) for name in STAGES[stage])]
    return subprocess.run([*inside, *pytest], cwd=REPOSITORY, check=False).returncode


def _keep_logs(stage: str) -> None:
    """Copy the node's logs, and what its pods said, to where they are looked for."""
    os.sync()
    shutil.copytree(NODE_LOGS, INSIDE_LOGS / f"node-{stage}", dirs_exist_ok=True)
    for what in ("pods", "events", "ctxp"):
        with (INSIDE_LOGS / f"{what}-{stage}.txt").open("w") as file:
            kubectl = [sys.executable, "-m", "tests.node", "exec", "--", str(BIN / "kubectl")]
            argv = [*kubectl, "get", what, "-A", "-o", "yaml" if what != "events" else "wide"]
            subprocess.run(argv, stdout=file, stderr=file, check=False, timeout=300)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    {"node": start_node, "tests": run_tests}[sys.argv[1]]()
