"""Run a command while this machine's processors are as slow as a robot's board.

    python -m tests.bench.slow_board raspberry-pi-4 -- python -m tests.bench.reaction --only table

What makes them slow is a thread of realtime priority on each that takes its part of every two milliseconds, so that all
else, the kubelet and our own measuring included, gets the rest. A CPU quota would not do: within its period it lets
work run at full speed and then stops it, and what takes less than the quota is not slowed at all.

How slow a board is comes from 7-zip's benchmark with one thread: published for the boards, run here for this machine
(`7zr b -mmt1` of Debian's p7zip), and run again beside the threads to see what was reached. It says nothing of a
board's memory bandwidth or its card; and a board has four processors, not as many as there are here. Needs root.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

BOARDS = {"raspberry-pi-4": 1769, "raspberry-pi-5": 3196}
"""MIPS of one core in 7-zip's benchmark: sbc-bench's Results.md, Debian for arm64, at 1.8 and 2.4 GHz."""
PERIOD = 0.002
HEADROOM = 0.9
"""The kernel stops realtime threads that take more than 95 % of each second."""


def main() -> int:
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    own = mips()
    part = BOARDS[options.board] / own
    if not 1 - HEADROOM < part < 1:
        sys.exit(f"this machine's core has {own} MIPS, a {options.board}'s {BOARDS[options.board]}: not to be emulated")
    with slowed(part):
        reached = mips()
        print(f"{options.board}: {BOARDS[options.board]} MIPS a core; here {own}, slowed {reached}", file=sys.stderr)
        with subprocess.Popen(options.command) as process:
            try:
                return process.wait()
            finally:
                process.terminate()  # and it tidies up while the processors are still slow


def mips() -> int:
    """What a core does now."""
    command = ["7zr", "b", "1", "-mmt1"]
    return rating(subprocess.run(command, check=True, capture_output=True, text=True, timeout=600).stdout)


def rating(output: str) -> int:
    """The last number of 7-zip's last line: compressing and decompressing, averaged."""
    found = re.search(r"^Tot:.*?(\d+)\s*$", output, re.MULTILINE)
    if not found:
        raise ValueError(f"no total in what 7zr printed: {output[-200:]!r}")
    return int(found.group(1))


@contextmanager
def slowed(part: float) -> Iterator[None]:
    """Leave this part of each processor to the rest of the machine."""
    thieves = [get_context("spawn").Process(target=_steal, args=(cpu, 1 - part)) for cpu in os.sched_getaffinity(0)]
    try:
        for thief in thieves:
            thief.start()
        yield
    finally:
        for thief in thieves:
            thief.kill()
            thief.join()


def _steal(cpu: int, part: float) -> None:
    os.sched_setaffinity(0, {cpu})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    # All at once: the kernel moves a thread whose processor is taken to one that is not.
    begin, parent = time.monotonic() // PERIOD * PERIOD, os.getppid()
    while os.getppid() == parent:
        while time.monotonic() < begin + part * PERIOD:
            pass
        begin += PERIOD
        time.sleep(max(0.0, begin - time.monotonic()))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.slow_board",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("board", choices=BOARDS)
    parser.add_argument("command", nargs="+", help="what to run, after --")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
