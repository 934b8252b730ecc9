"""Takes what a processor does beyond a pace from all else that runs on it: `thief.py PROCESSOR PACE`.

It has realtime priority and begins every PERIOD with turns of a loop, whose number says how fast the processor is at
the moment; how long it goes on follows from that. Once a second it writes a line: how many seconds of each it left to
all else, and how many turns could be done in them. A program of its own, which imports nothing of this project, so
that it is there soon.
"""

from __future__ import annotations

import os
import sys
import time

PERIOD = 0.005
LEAST = 0.05
"""Part of each period that it takes at least, to learn how fast the processor is."""
MEMORY = 0.1
"""Seconds over which the speed is averaged: what shares a core of the host comes and goes within a second."""
LINE = 1.0
"""Seconds between lines."""
TURN = range(50)
PRIORITY = 2
"""Among realtime threads; what plays the sensors' inputs has the one below (`confine`)."""


class Pacer:
    """How much to take of each period so that a pace, in turns a second, is left. Pure."""

    def __init__(self, pace: float) -> None:
        self._pace, self._speed = pace, pace / (1 - LEAST)
        self._seconds = self._turns = 0.0

    def take(self) -> float:
        """Seconds to take of the next period."""
        return PERIOD * max(LEAST, 1 - self._pace / self._speed)

    def took(self, turns: int, seconds: float, left: float) -> None:
        """Learn from a period: so many turns in so many seconds, after which others had `left` seconds of it.

        What is missing is nobody's: the host ran something else, or we were woken late.
        """
        if turns:
            self._speed += (turns / seconds - self._speed) * min(1.0, PERIOD / MEMORY)
        self._seconds += left
        self._turns += self._speed * left

    def line(self, seconds: float) -> tuple[float, float]:
        """What was left since the last line, which was so many seconds ago: seconds of each, and turns in them."""
        found = self._seconds / seconds, self._turns / seconds
        self._seconds = self._turns = 0.0
        return found


def turns(until: float) -> int:
    """Do turns of the loop until then, and return how many."""
    done = 0
    while time.monotonic() < until:
        total = 0
        for one in TURN:
            total += one
        done += 1
    return done


def _steal(processor: int, pace: float) -> None:
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    _write("begins")
    # All at once: the kernel moves a thread whose processor is taken to one that is not.
    begin, parent, pacer = time.monotonic() // PERIOD * PERIOD, os.getppid(), Pacer(pace)
    line = begin
    while os.getppid() == parent:
        woken = time.monotonic()
        done = turns(begin + pacer.take())
        now = time.monotonic()
        begin += PERIOD
        pacer.took(done, now - woken, max(0.0, begin - now))
        begin = max(begin, now)
        if begin - line >= LINE:
            _write("{:.4f} {:.0f}".format(*pacer.line(begin - line)))
            line = begin
        time.sleep(max(0.0, begin - time.monotonic()))


def _write(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    _steal(int(sys.argv[1]), float(sys.argv[2]))
