"""Run a command while this machine's processors are as slow as a robot's board.

    python -m tests.bench.slow_board raspberry-pi-4 -- python -m tests.bench.reaction --only table

`timelines.experiments.slowed` says what makes them slow.

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

from timelines.experiments.slowed import slowed, speed

SLOWEST = 0.1
"""Part of a core that is left at least: the kernel stops realtime threads that take more than 95 % of each second."""

BOARDS = {"raspberry-pi-4": 1769, "raspberry-pi-5": 3196}
"""MIPS of one core in 7-zip's benchmark: sbc-bench's Results.md, Debian for arm64, at 1.8 and 2.4 GHz."""


def main() -> int:
    options = _options()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    own = mips()
    part = BOARDS[options.board] / own
    if not SLOWEST < part < 1:
        sys.exit(f"this machine's core has {own} MIPS, a {options.board}'s {BOARDS[options.board]}: not to be emulated")
    processors = os.sched_getaffinity(0)
    with slowed(part * speed(min(processors)), processors):
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
