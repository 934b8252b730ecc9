"""Runs inside the machine, as its services: starts the node; then runs the tests, around one reboot."""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

from tests.node import lifecycle
from tests.node.layout import BIN, REPOSITORY
from tests.node.layout import LOGS as NODE_LOGS
from tests.vm.places import INSIDE_LOGS, TESTS_VARIABLE

if TYPE_CHECKING:
    from collections.abc import Sequence

log = logging.getLogger(__name__)

STAGES = {"running": ("test_systemd.py", "test_hostile.py", "test_running.py"), "rebooted": ("test_rebooted.py",)}
"""What runs before the machine is rebooted, and what after."""
FILES = tuple(file for files in STAGES.values() for file in files)
TESTS = REPOSITORY / "tests" / "vm" / "inside"
OWN_CONFTEST = ("--confcutdir", str(TESTS))
"""What the conftest.py further up wants is not on the machine."""


def stages(chosen: Sequence[str]) -> dict[str, list[str]]:
    """Return the stages that have tests to run, and these: all, or the files and FILE::TEST that were chosen."""
    found = {stage: [one for one in chosen or FILES if _file(one) in files] for stage, files in STAGES.items()}
    return {stage: tests for stage, tests in found.items() if tests}


def _file(test: str) -> str:
    return test.partition("::")[0]


def start_node() -> None:
    """Start the node; nothing has to be built, for everything is on the disk."""
    lifecycle.boot()


def run_tests() -> None:
    """Run the tests of the stage that comes next; then reboot, or power off after the last."""
    plan = stages(os.environ.get(TESTS_VARIABLE, "").split())
    stage = next(stage for stage in plan if not (INSIDE_LOGS / stage).exists())
    verdict = INSIDE_LOGS / stage
    verdict.write_text("unknown: it did not end")
    try:
        verdict.write_text(str(_pytest(plan[stage])))
    finally:
        _keep_logs(stage)
        last = stage == list(plan)[-1]
        subprocess.run(["systemctl", "poweroff" if last else "reboot"], check=True, timeout=300)


def _pytest(tests: Sequence[str]) -> int:
    options = ["-v", "-p", "no:cacheprovider", "-o", "faulthandler_timeout=0", "--maxfail=3", "--durations=0"]
    inside = [sys.executable, "-m", "tests.node", "exec", "--"]
    pytest = [sys.executable, "-m", "pytest", *OWN_CONFTEST, *options, *(str(TESTS / name) for name in tests)]
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
