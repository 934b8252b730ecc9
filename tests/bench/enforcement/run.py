"""One cell: start the tasks together, write what each context wants when it begins, and collect what became of it."""

from __future__ import annotations

import math
import mmap
import multiprocessing
import os
import time
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.bench.enforcement.figures import Run
from tests.bench.enforcement.matrix import taken
from tests.bench.enforcement.worker import cpu_seconds, prepare, serve, stay

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tests.bench.enforcement.divisions import Division, Setting
    from tests.bench.enforcement.groups import Groups
    from tests.bench.enforcement.inputs import Inputs
    from tests.bench.enforcement.matrix import Cell
    from tests.bench.enforcement.stories import Script, Task

FORK = multiprocessing.get_context("fork")
HEAD_START = 0.05
"""Seconds from the barrier to the first input."""
DRAINED = 2.0
"""Seconds after the last context in which waiting inputs may still be done."""
PATIENCE = 10.0
"""Seconds in which a task has to start, or to end."""


class Started:
    """The tasks' processes of a cell, waiting for their start in their groups."""

    def __init__(self, cell: Cell, tasks: Sequence[Task], script: Script, groups: Groups) -> None:
        self._script = script
        self._groups = groups
        self.boards: dict[str, memoryview[float]] = {}
        self._processes = {}
        self._ready, ready = FORK.Pipe(duplex=False)
        begun, self._begin = os.pipe()
        self._theirs = ready, begun
        for task in tasks:
            own = taken(cell, task, script)
            self.boards[task.name] = board = memoryview(mmap.mmap(-1, 8 * own.count)).cast("d")
            for number in range(own.count):
                board[number] = math.nan
            self._processes[task.name] = FORK.Process(target=self._task, args=(task, own, board, ready, begun))

    @property
    def ids(self) -> dict[str, int]:
        """The processes' ids."""
        return {name: process.pid or 0 for name, process in self._processes.items()}

    def launch(self) -> None:
        """Start them, and wait until all are in their groups."""
        for process in self._processes.values():
            process.start()
        for _ in self._processes:
            if not self._ready.poll(PATIENCE):
                raise SystemExit("a task does not start")
            self._ready.recv_bytes()

    def start(self) -> float:
        """Let all begin at one time, which is returned."""
        start = time.monotonic() + HEAD_START
        os.write(self._begin, repr(start).encode().ljust(_MESSAGE) * len(self._processes))
        return start

    def drain(self, names: set[str]) -> bool:
        """Wait until those have nothing left to do; False if they need too long."""
        left = [self._processes[name].sentinel for name in names]
        deadline = time.monotonic() + DRAINED
        while left and (ended := wait(left, max(0.0, deadline - time.monotonic()))):
            left = [one for one in left if one not in ended]
        return not left

    def end(self) -> None:
        """End all that still run."""
        ready, begun = self._theirs
        ready.close()
        self._ready.close()
        os.close(begun)
        os.close(self._begin)
        self._groups.reset()
        launched = [process for process in self._processes.values() if process.pid is not None]
        for process in launched:
            process.kill()
        for process in launched:
            process.join(PATIENCE)
            if process.is_alive():
                raise SystemExit(f"task {process.pid} does not end")

    def _task(self, task: Task, own: Inputs, board: memoryview[float], ready: Any, begun: int) -> None:
        self._groups.join(task.name)
        os.close(self._begin)
        prepare()
        ready.send_bytes(b"1")
        message = os.read(begun, _MESSAGE)
        if not message:
            os._exit(1)
        start = float(message)
        serve(own, task.cost, start, board)
        stay(start + self._script.end + 0.01)


_MESSAGE = 32


def measure(cell: Cell, division: Division, tasks: Sequence[Task], script: Script, groups: Groups) -> Run:
    """Run it once."""
    with _started(cell, tasks, script, groups) as started:
        contexts = script.story.contexts
        started.launch()
        groups.begin(division.settings[contexts[0].name], started.ids)
        busy, begun = busy_seconds(), {name: cpu_seconds(process) for name, process in started.ids.items()}
        start, late = started.start(), 0.0
        for number, context in enumerate(contexts[1:], start=1):
            late = max(late, _change(start + number * script.seconds, groups, division.settings[context.name], started))
        _sleep_until(start + script.end)
        work = {name: cpu_seconds(process) - begun[name] for name, process in started.ids.items()}
        foreign = busy_seconds() - busy - sum(work.values())
        awake = {task.name for task in tasks} - contexts[-1].suspends
        drained = started.drain(awake)
        finished = {name: list(board) for name, board in started.boards.items()}
    return Run.of(tasks, script, finished, work, awake if drained else None, late=late, foreign=foreign)


@contextmanager
def _started(cell: Cell, tasks: Sequence[Task], script: Script, groups: Groups) -> Iterator[Started]:
    started = Started(cell, tasks, script, groups)
    try:
        yield started
    finally:
        started.end()
        groups.close_realtime()


def _change(due: float, groups: Groups, settings: Mapping[str, Setting], started: Started) -> float:
    """Write a context's settings at its time, limits that come later at theirs; how late the first ones were."""
    grace = max(setting.after for setting in settings.values())
    _sleep_until(due)
    groups.apply({n: replace(s, quota=None) if s.after else s for n, s in settings.items()}, started.ids)
    late = time.monotonic() - due
    if grace:
        _sleep_until(due + grace)
        groups.apply(settings, started.ids)
    return late


def _sleep_until(moment: float) -> None:
    time.sleep(max(0.0, moment - time.monotonic()))


def busy_seconds() -> float:
    """What all processors have worked since boot, and what the hypervisor took from them."""
    ticks = [int(text) for text in Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:9]]
    return (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf("SC_CLK_TCK")
