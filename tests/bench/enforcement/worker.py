"""One task as a process: it takes its inputs as they come and burns CPU time for each.

What an input costs is measured with the thread's CPU clock: an input is CPU seconds, however long they take.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.bench.enforcement.inputs import Inputs

SPIN = range(500)
"""About ten microseconds between two looks at the clock, which is a system call."""
_DIE_WITH_PARENT = 1


def burn(seconds: float) -> None:
    """Use that much CPU time."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        for _ in SPIN:
            pass


def serve(inputs: Inputs, cost: float, start: float, finished: memoryview[float]) -> None:
    """Handle the inputs; `finished` gets the time of each after `start`, and keeps what it has for the others.

    Returns when no input can come any more.
    """
    last = -1
    while True:
        now = time.monotonic() - start
        number = inputs.next(last, now)
        if number is not None:
            burn(cost)
            finished[number] = time.monotonic() - start
            last = number
            continue
        wake = inputs.wake(last, now)
        if wake is None:
            return
        time.sleep(wake - now)


def prepare() -> None:
    """Let nothing but inputs cost time from now on, and end with the parent."""
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the harness ends its tasks
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    gc.disable()
    burn(0.002)


def cpu_seconds(process: int) -> float:
    """What a process has used: the kernel's clock of another process (clock_getcpuclockid(3))."""
    return time.clock_gettime((~process << 3) | 2)


def stay(until: float) -> None:
    """Wait, so that the process's clock can still be read."""
    time.sleep(max(0.0, until - time.monotonic()))
    os._exit(0)
