"""Keeps the tasks on their processors, and what plays to them as punctual as the sensors that it stands for."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from timelines.demo.deploy import DeployError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

PASSES = 2
"""A thread that is started meanwhile has its starter's processors and priority, old or new."""
PLAYERS = 1
"""Our realtime priority: below a thief's, whose part of each period has to be exact."""


class Contained(Protocol):
    """A container, such as a `timelines.demo.cgroup.Cgroup`."""

    def processes(self) -> list[int]:
        """The ids of its processes."""


def first(count: int) -> set[int]:
    """The first so many processors that we may use."""
    return set(sorted(os.sched_getaffinity(0))[:count])


def confine(cgroups: Mapping[str, Contained], tasks: Collection[str], processors: set[int]) -> None:
    """Let all threads of these tasks run there, and nowhere else."""
    for _ in range(PASSES):
        for thread in _threads(cgroups, tasks):
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setaffinity(thread, processors)


@contextmanager
def keep_off(processors: set[int]) -> Iterator[None]:
    """Keep our own threads, which play and record, off these processors where there are others."""
    allowed = os.sched_getaffinity(0)
    _move(allowed - processors or allowed)
    try:
        yield
    finally:
        _move(allowed)


@contextmanager
def punctual() -> Iterator[None]:
    """Run what plays, records and orders the wheels before all tasks: a camera does not wait for CPU as they do.

    As ordinary threads they waited longer under weights than under Linux default, sent what was overdue in bursts, and
    lost some of it. Threads that are started meanwhile inherit the priority.
    """
    _schedule(os.SCHED_FIFO, PLAYERS)
    try:
        yield
    finally:
        _schedule(os.SCHED_OTHER, 0)


def _move(processors: set[int]) -> None:
    for thread in _own_threads():
        with suppress(ProcessLookupError):  # it has ended
            os.sched_setaffinity(thread, processors)


def _schedule(policy: int, priority: int) -> None:
    for thread in chain.from_iterable(_own_threads() for _ in range(PASSES)):
        with suppress(ProcessLookupError):
            os.sched_setscheduler(thread, policy, os.sched_param(priority))


def _own_threads() -> list[int]:
    return [int(path.name) for path in Path("/proc/self/task").iterdir()]


def check(cgroups: Mapping[str, Contained], tasks: Collection[str], processors: set[int]) -> None:
    """DeployError if a task has got more, since somebody has written its cpuset.

    Nor may any container have been started again meanwhile: what it used until then is no longer counted.
    """
    for name, cgroup in cgroups.items():
        if not cgroup.processes():
            raise DeployError(f"the container of {name} has ended during the run")
    for thread in _threads(cgroups, tasks):
        with suppress(ProcessLookupError):
            if not os.sched_getaffinity(thread) <= processors:
                raise DeployError(f"thread {thread} of a task may run on processors other than {processors}")


def _threads(cgroups: Mapping[str, Contained], tasks: Collection[str]) -> Iterator[int]:
    for task in tasks:
        for process in cgroups[task].processes() if task in cgroups else ():
            with suppress(FileNotFoundError):
                yield from [int(path.name) for path in Path(f"/proc/{process}/task").iterdir()]
