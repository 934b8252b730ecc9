"""The scheduling policy of a container's threads."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

THREAD_FILES = {1: "tasks", 2: "cgroup.threads"}
"""The file that lists a group's threads, by cgroup version."""

_REALTIME = (os.SCHED_FIFO, os.SCHED_RR)
_ROUNDS = 10
"""Threads may start while their siblings are changed; each round catches those that the one before missed."""


def make_realtime(group: Path, version: int, priority: int, policy: int = os.SCHED_RR) -> None:
    """Move all threads of the group to realtime priority; threads and processes started later inherit it."""
    parameters = os.sched_param(priority)
    _change(group, version, lambda now: None if now in _REALTIME else (policy, parameters))


def make_ordinary(group: Path, version: int) -> None:
    """Move all threads of the group back to the fair scheduler, with the nice values they had."""
    parameters = os.sched_param(0)
    _change(group, version, lambda now: (os.SCHED_OTHER, parameters) if now in _REALTIME else None)


def _change(group: Path, version: int, new: Callable[[int], tuple[int, os.sched_param] | None]) -> None:
    """Repeat until a whole pass changes nothing."""
    for _ in range(_ROUNDS):
        if not [thread for thread in _threads(group, version) if _change_one(thread, new)]:
            return


def _threads(group: Path, version: int) -> list[int]:
    try:
        threads = [int(line) for line in (group / THREAD_FILES[version]).read_text().split()]
    except OSError as error:
        raise ActuationError("Gone", f"{group}: {error.strerror}", retriable=False) from error
    if 0 in threads:
        raise ActuationError("NoHostPids", f"{group}: its processes are not visible: set hostPID", retriable=False)
    return threads


def _change_one(thread: int, new: Callable[[int], tuple[int, os.sched_param] | None]) -> bool:
    try:
        # The kernel returns the policy with this flag or'ed in.
        wanted = new(os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK)
        if wanted is not None:
            os.sched_setscheduler(thread, *wanted)
    except ProcessLookupError:
        return False
    except PermissionError as error:
        raise ActuationError("Forbidden", f"scheduling policy of thread {thread}: {error}", retriable=False) from error
    return wanted is not None
