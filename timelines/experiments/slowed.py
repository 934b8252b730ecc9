"""Processors that are as slow as a board's: what makes them so is a thread of realtime priority on each.

It takes its part of every two milliseconds, so that all else, the kubelet and our own measuring included, gets the
rest. A CPU quota would not do: within its period it lets work run at full speed and then stops it, and what takes less
than the quota is not slowed at all. These threads compete with realtime tasks: such rows are not to be measured beside
them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from timelines.experiments.capacity import Capacity

PERIOD = 0.002
HEADROOM = 0.9
"""The kernel stops realtime threads that take more than 95 % of each second."""
OFF = 0.1
"""Part of what they should leave by which thieves may be off: a load of 1.4 is then one of 1.3 to 1.6."""


class SlowedError(Exception):
    """The processors were not slowed all the time, or not as much as they should be."""


class Thieves:
    """The processes that slow the processors, or none."""

    def __init__(self, processes: Sequence[int]) -> None:
        self._processes = processes

    def seconds(self) -> float:
        """CPU that they have taken so far, by their own clocks: what they should take is not what they get."""
        return sum(process_seconds(process) for process in self._processes)


def process_seconds(process: int) -> float:
    """CPU seconds of a process of one thread so far."""
    return int(Path(f"/proc/{process}/schedstat").read_text(encoding="ascii").split()[0]) / 1e9


def check(taken: float, capacity: Capacity, seconds: float) -> None:
    """SlowedError if thieves have left much more or less than they should in so many seconds; `taken` is theirs."""
    left = capacity.processors * capacity.part * seconds
    due = capacity.processors * seconds - left
    if abs(taken - due) > OFF * left:
        raise SlowedError(f"what slows the processors took {taken:.2f} s of them instead of {due:.2f} s")


@contextmanager
def slowed(part: float, processors: Collection[int]) -> Iterator[Thieves]:
    """Leave this part of each of these processors to all else; with all of it nothing is started.

    SlowedError if what slows them does not begin, or has ended before the block does.
    """
    # Programs of their own, which import nothing of this project: they are there soon.
    thieves = [_thief(cpu, 1 - part) for cpu in processors if part < 1]
    try:
        if not all(_out(thief).readline() for thief in thieves):
            raise SlowedError("can't slow the processors: expected permission to use realtime priorities")
        yield Thieves([thief.pid for thief in thieves])
        if any(thief.poll() is not None for thief in thieves):
            raise SlowedError("the process that slows the processors has ended")
    finally:
        for thief in thieves:
            thief.kill()
            thief.wait()
            _out(thief).close()


def _thief(cpu: int, part: float) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, __file__, str(cpu), str(part)], stdout=subprocess.PIPE, text=True)


def _out(thief: subprocess.Popen[str]) -> IO[str]:
    """Where it says that it has begun; empty once it has ended."""
    return cast("IO[str]", thief.stdout)


def _steal(cpu: int, part: float) -> None:
    os.sched_setaffinity(0, {cpu})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    sys.stdout.write("begins\n")
    sys.stdout.flush()
    # All at once: the kernel moves a thread whose processor is taken to one that is not.
    begin, parent = time.monotonic() // PERIOD * PERIOD, os.getppid()
    while os.getppid() == parent:
        while time.monotonic() < begin + part * PERIOD:
            pass
        begin += PERIOD
        time.sleep(max(0.0, begin - time.monotonic()))


if __name__ == "__main__":
    _steal(int(sys.argv[1]), float(sys.argv[2]))
