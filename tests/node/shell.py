"""Running other programs: bounded in time, and with their own words in the error."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import time
from typing import TYPE_CHECKING

from tests.node.errors import ClusterError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

log = logging.getLogger(__name__)

PATIENCE = float(os.environ.get("CONTEXTPOLICY_NODE_PATIENCE", "1"))
"""Every bound of a wait, and the pause between two looks, is multiplied by this on a machine that is slow."""
HEARTBEAT = 15.0
POLL = 0.1


def run(
    argv: Sequence[str], *, timeout: float = 60, env: Mapping[str, str] | None = None, stdin: str | None = None
) -> str:
    """Return what the program printed; a failure or a timeout is a ClusterError with its last words."""
    try:
        limit = timeout * PATIENCE
        done = subprocess.run(argv, capture_output=True, text=True, timeout=limit, env=env, input=stdin, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ClusterError(f"{argv[0]}: {error}") from error
    if done.returncode:
        words = (done.stderr or done.stdout).strip()
        raise ClusterError(f"{' '.join(argv)}: exit {done.returncode}\n{words}")
    return done.stdout


def succeeds(argv: Sequence[str], *, timeout: float = 10) -> bool:
    try:
        run(argv, timeout=timeout)
    except ClusterError:
        return False
    return True


def run_long(what: str, argv: Sequence[str], *, output: Path, timeout: float, env: Mapping[str, str]) -> None:
    """Run for minutes: the program's output goes to a file, a line with the elapsed time to the terminal."""
    started = time.monotonic()
    log.info("%s ...", what)
    output.parent.mkdir(parents=True, exist_ok=True)
    with (
        output.open("w") as file,
        subprocess.Popen(argv, stdout=file, stderr=file, env=env, start_new_session=True) as process,
    ):
        try:
            while process.poll() is None:
                _heartbeat(what, process, elapsed=time.monotonic() - started, timeout=timeout * PATIENCE)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)  # and all that it started
            raise
    if process.returncode:
        raise ClusterError(f"{what}: exit {process.returncode}, the end of {output}:\n{tail(output)}")
    log.info("%s: done in %.0f s", what, time.monotonic() - started)


def _heartbeat(what: str, process: subprocess.Popen[bytes], *, elapsed: float, timeout: float) -> None:
    if elapsed > timeout:
        raise ClusterError(f"{what}: not done after {timeout:.0f} s")
    try:
        process.wait(HEARTBEAT)
    except subprocess.TimeoutExpired:
        log.info("%s ... %.0f s", what, elapsed + HEARTBEAT)


def wait_until(condition: Callable[[], bool], *, timeout: float) -> bool:
    """Look at a condition until it holds; False when it did not in time."""
    deadline = time.monotonic() + timeout * PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(POLL * PATIENCE)
    return True


def tail(file: Path, *, lines: int = 20) -> str:
    if not file.exists():
        return f"{file} does not exist"
    return "\n".join(file.read_text(errors="replace").splitlines()[-lines:])
