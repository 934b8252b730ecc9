"""When a container's CPU limit changed: the kernel reports it (inotify), so no polling disturbs what is measured."""

from __future__ import annotations

import ctypes
import os
import struct
import threading
import time
from collections import defaultdict
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from timelines.demo.cgroup import Cgroup

_MODIFY = 0x2
_HEADER = struct.Struct("iIII")


class MissedError(Exception):
    """What was waited for did not happen in time."""


class Stopwatch:
    """Notes each change of the watched limits with its Unix time, from `with` to its end.

    The note is taken when this process runs after the write: its thread has a realtime priority, which keeps that to
    some tens of microseconds even on a saturated node; `write.py` shows how much, as it is part of its figure.
    """

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = self._checked(self._libc.inotify_init1(os.O_CLOEXEC))
        self._groups: dict[int, Cgroup] = {}
        self._seen: dict[Cgroup, list[tuple[float, float | None]]] = defaultdict(list)
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._follow, name="stopwatch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """The thread is a daemon: blocked in a read, it ends with the process."""

    def watch(self, group: Cgroup) -> None:
        """Note the group's limits from now on."""
        number = self._libc.inotify_add_watch(self._descriptor, bytes(group.quota_file), _MODIFY)
        self._groups[self._checked(number)] = group

    def forget(self) -> None:
        """Let go of what was noted so far."""
        with self._changed:
            self._seen.clear()

    def wait(self, wanted: Mapping[Cgroup, float], since: float, patience: float) -> dict[Cgroup, float]:
        """The time at which each group had its wanted limit for the first time; MissedError when one did not."""
        with self._changed:
            self._changed.wait_for(lambda: all(self._first(g, w, since) for g, w in wanted.items()), patience)
            found = {group: self._first(group, limit, since) for group, limit in wanted.items()}
        missed = [group for group, at in found.items() if at is None]
        if missed:
            raise MissedError(f"{len(missed)} of {len(wanted)} limits not in force after {patience:g} s")
        return {group: at for group, at in found.items() if at is not None}

    def steps(self, groups: Collection[Cgroup], since: float) -> list[tuple[float, Cgroup, float]]:
        """Each change of these limits from that moment on, in order: time, group, cores."""
        with self._changed:
            found = [
                (at, group, cores)
                for group in groups
                for at, cores in self._seen[group]
                if at >= since and cores is not None
            ]
        return sorted(found, key=lambda change: change[0])

    def _first(self, group: Cgroup, limit: float, since: float) -> float | None:
        steps = self._seen[group]
        return next((at for at, seen in steps if at >= since and seen is not None and abs(seen - limit) < 1e-6), None)

    def _follow(self) -> None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        while True:
            numbers = set(_numbers(os.read(self._descriptor, 1 << 16)))
            at = time.time()
            with self._changed:
                for number in numbers & self._groups.keys():
                    self._seen[self._groups[number]].append((at, self._groups[number].limit()))
                self._changed.notify_all()

    def _checked(self, result: int) -> int:
        if result < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code))
        return result


def _numbers(events: bytes) -> Iterator[int]:
    """The watches whose files were written; an event may be followed by a name."""
    position = 0
    while position < len(events):
        number, mask, _, length = _HEADER.unpack_from(events, position)
        position += _HEADER.size + length
        if mask & _MODIFY:
            yield number
