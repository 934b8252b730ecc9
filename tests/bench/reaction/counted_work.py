"""What a task really computes: it counts its work in shared memory, which costs it nothing to publish."""

from __future__ import annotations

import mmap
import os
import threading
import time
from typing import TYPE_CHECKING

from tests.bench.reaction.stopwatch import MissedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from timelines.demo.cgroup import Cgroup

FILE = "/dev/shm/work"  # noqa: S108 - in the container's own memory
SIGNALLED = """
import json, mmap, os, signal, sys, time
until = 0.0
def work(*_):
    global until
    until = time.monotonic() + 30
def rest(*_):
    global until
    until = 0.0
signal.signal(signal.SIGUSR1, work)
signal.signal(signal.SIGUSR2, rest)
"""
"""How work begins that lasts 30 s after SIGUSR1, or until SIGUSR2: a benchmark that is killed leaves no busy node."""
COUNT = f"""{SIGNALLED}
file = os.open({FILE!r}, os.O_RDWR | os.O_CREAT, 0o600)
os.ftruncate(file, 8)
count = memoryview(mmap.mmap(file, 8)).cast("Q")
while True:
    if time.monotonic() >= until:
        time.sleep(0.01)
        continue
    for _ in range(1000):
        pass
    count[0] += 1
"""
"""Counts loops of a thousand turns while it works."""


class CountedWork:
    """The count of one task, read through its process's own view of its files."""

    def __init__(self, group: Cgroup) -> None:
        self._group = group
        [process] = group.processes()
        descriptor = os.open(f"/proc/{process}/root{FILE}", os.O_RDONLY)
        self._memory = mmap.mmap(descriptor, 8, prot=mmap.PROT_READ)
        os.close(descriptor)

    def during(self, began: float, seconds: float) -> Measured:
        """What it does from now until so long after `began`, a Unix time."""
        return Measured(self._look, began + seconds)

    def close(self) -> None:
        """Look no more."""
        self._memory.close()

    def _look(self) -> tuple[int, float]:
        return int.from_bytes(self._memory[:8], "little"), self._group.usage()


class Measured:
    """Looks twice: now, and on a thread of realtime priority when the time is over."""

    def __init__(self, look: Callable[[], tuple[int, float]], until: float) -> None:
        self._look, self._until = look, until
        self._before = self._after = look()
        self._thread = threading.Thread(target=self._wait, name="counted work")
        self._thread.start()

    def result(self) -> tuple[int, float]:
        """Loops, and seconds of CPU."""
        self._thread.join(max(0.0, self._until - time.time()) + 5.0)
        if self._thread.is_alive():
            raise MissedError("the task's count was not read in time")
        loops, cpu = (after - before for after, before in zip(self._after, self._before, strict=True))
        return int(loops), cpu

    def _wait(self) -> None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        time.sleep(max(0.0, self._until - time.time()))
        self._after = self._look()
