"""The command line: python -m tests.vm [FILE[::TEST] ...] builds the machine, runs tests in it, says how they ended."""

from __future__ import annotations

import argparse
import logging
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from tests.node import build
from tests.node.errors import ClusterError
from tests.node.lock import held
from tests.node.shell import PATIENCE, run
from tests.vm import machine, payload, system
from tests.vm.guest import FILES, stages
from tests.vm.places import BUILD, CONSOLE, DISK, INSIDE_LOGS, LOGS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

log = logging.getLogger(__name__)

DEBIAN_PACKAGES = ("e2fsprogs", "qemu-system-x86")
TIMEOUT = 5400.0


def main(argv: Sequence[str] | None = None) -> int:
    """Exit 0 when every test passed; the logs stay in build/vm/ otherwise."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    tests = parser().parse_args(argv).tests
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    started = time.monotonic()
    try:
        with held("vm"):
            build.install_packages(DEBIAN_PACKAGES)
            failed = _run(tests)
    except ClusterError as error:
        log.error("error: %s", error)  # noqa: TRY400, the message is the explanation
        return 1
    log.info("%s after %.0f s", failed or "all tests in the machine passed", time.monotonic() - started)
    return 1 if failed else 0


def parser() -> argparse.ArgumentParser:
    """Return the command line; it refuses tests that are in no file of the machine's."""
    top = argparse.ArgumentParser(prog="python -m tests.vm", description="Tests in a virtual machine with systemd.")
    described = f"{', '.join(FILES)}, or a test of these; all if none is named"
    top.add_argument("tests", nargs="*", type=_test, metavar="FILE[::TEST]", help=described)
    return top


def _test(name: str) -> str:
    if not stages([name]):
        raise argparse.ArgumentTypeError(f"{name}: its file is none of {', '.join(FILES)}")
    return name


def _run(tests: Sequence[str]) -> str:
    """Return what failed."""
    shutil.rmtree(BUILD, ignore_errors=True)
    root = BUILD / "root"
    try:
        system.unpack(root)
        payload.write(root, tests)
        kernel, initial = (Path(shutil.copy(file, BUILD)) for file in system.kernel(root))
        system.make_disk(root, DISK)
        shutil.rmtree(root)
        machine.run(machine.command(kernel, initial, DISK), CONSOLE, timeout=TIMEOUT * PATIENCE)
    finally:
        shutil.rmtree(root, ignore_errors=True)
        if DISK.exists():
            _read_logs()
            DISK.unlink()
    return _verdict(stages(tests))


def _read_logs() -> None:
    LOGS.mkdir(parents=True, exist_ok=True)
    run(["debugfs", "-R", f"rdump {INSIDE_LOGS} {LOGS}", str(DISK)], timeout=120)


def _verdict(planned: Iterable[str]) -> str:
    codes = {stage: LOGS / INSIDE_LOGS.name / stage for stage in planned}
    return ", ".join(
        f"{stage}: {'exit ' + file.read_text() if file.exists() else 'not run'}; see {LOGS} and {CONSOLE}"
        for stage, file in codes.items()
        if not file.exists() or file.read_text() != "0"
    )


if __name__ == "__main__":
    sys.exit(main())
