"""Processors of one speed, as slow as a board's, beside whatever else the host runs.

What makes them so is a thread of realtime priority on each (`thief`): it takes what a processor does beyond a pace, so
that all else, the kubelet included, gets the rest. A core of a host that others share is now
half as fast as it was a second ago, and no comparison would survive that. A CPU quota would not do: within its period
it lets work run at full speed and then stops it, and what takes less than the quota is not slowed at all. These
threads compete with realtime tasks, which are not to be measured beside them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from statistics import fmean, median
from typing import IO, TYPE_CHECKING, NamedTuple, cast

from timelines.experiments import thief
from timelines.experiments.calm import DisturbedError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

LOOK, LOOKS = 0.5, 5
"""Seconds of each look at an undisturbed processor's speed, and how many there are."""


class SlowedError(DisturbedError):
    """What slows the processors did not run all the time."""


class Pace(NamedTuple):
    """Turns that all else could do in a second of CPU, and the part of the pace that it had: on average, at worst."""

    speed: float
    left: float
    worst: float


class Thieves:
    """The processes that slow the processors to a pace."""

    def __init__(self, processes: Sequence[subprocess.Popen[str]], pace: float) -> None:
        self._processes, self._pace = processes, pace
        self._lines: list[str] = []

    def seconds(self) -> float:
        """CPU that they have taken so far, by their own clocks."""
        return sum(process_seconds(one.pid) for one in self._processes)

    def pace(self) -> Pace:
        """What they found while the block ran, once it has ended; SlowedError if that is nothing."""
        return left_by([[float(word) for word in line.split()] for line in self._lines], self._pace)

    def end(self) -> None:
        """End them, and keep what they have written."""
        for one in self._processes:
            one.kill()
            self._lines += one.communicate()[0].splitlines()


class Untouched:
    """In place of them, where processors stay as they are: so many turns a second."""

    def __init__(self, turns: float) -> None:
        self._turns = turns

    def seconds(self) -> float:
        """No CPU is taken."""
        return 0.0

    def pace(self) -> Pace:
        """What was found before."""
        return Pace(round(self._turns), 1.0, 1.0)


def left_by(lines: Sequence[Sequence[float]], pace: float) -> Pace:
    """What thieves' lines come to, of the pace that they were to leave; SlowedError if there are none. Pure."""
    if not lines:
        raise SlowedError("what slows the processors said nothing: expected a line every second")
    left = [one / pace for _, one in lines]
    speed = fmean(turns for _, turns in lines) / fmean(seconds for seconds, _ in lines)
    return Pace(round(speed), round(fmean(left), 3), round(min(left), 3))


def process_seconds(process: int) -> float:
    """CPU seconds of a process of one thread so far."""
    return int(Path(f"/proc/{process}/schedstat").read_text(encoding="ascii").split()[0]) / 1e9


@contextmanager
def slowed(pace: float, processors: Collection[int]) -> Iterator[Thieves]:
    """Leave each of these processors this pace, in turns of the thieves' loop a second.

    SlowedError if what slows them does not begin, or has ended before the block does.
    """
    processes = [_thief(cpu, pace) for cpu in processors]
    thieves = Thieves(processes, pace)
    try:
        if not all(_out(one).readline() for one in processes):
            raise SlowedError("can't slow the processors: expected permission to use realtime priorities")
        yield thieves
        if any(one.poll() is not None for one in processes):
            raise SlowedError("the process that slows the processors has ended")
    finally:
        thieves.end()


def _thief(cpu: int, pace: float) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, thief.__file__, str(cpu), str(pace)], stdout=subprocess.PIPE, text=True)


def _out(process: subprocess.Popen[str]) -> IO[str]:
    """Where it says that it has begun; empty once it has ended."""
    return cast("IO[str]", process.stdout)


def speed(processor: int) -> float:
    """How fast a processor is now: turns of the thieves' loop in a second of its CPU, the median of LOOKS looks.

    What shares a core of the host comes and goes.
    """
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {processor})
    try:
        return median(_turns_a_second() for _ in range(LOOKS))
    finally:
        os.sched_setaffinity(0, allowed)


def _turns_a_second() -> float:
    began = time.thread_time()
    return thief.turns(time.monotonic() + LOOK) / (time.thread_time() - began)
