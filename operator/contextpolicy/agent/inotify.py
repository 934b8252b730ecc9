"""Notice when others write files: one blocked thread, woken by the kernel."""

from __future__ import annotations

import ctypes
import errno
import os
import struct
import threading
import time
from math import inf
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_CLOSE_WRITE, _OVERFLOW = 0x8, 0x4000
_HEADER = struct.Struct("iIII")
_BUFFER = 4096
_SPENT = {
    errno.ENOSPC: "no watch is left for its user: raise fs.inotify.max_user_watches",
    errno.EMFILE: "no inotify instance is left for its user: raise fs.inotify.max_user_instances",
}
"""What the kernel's errors mean here; their own texts are about disks and files."""


class WriteListener(Protocol):
    """Receives writes; called on the watch's own thread."""

    def on_write(self, path: Path, heard: float) -> None:
        """The file was closed after it was opened for writing.

        `heard` is the time in seconds on the monotonic clock, -infinity where the kernel has lost reports: then any
        file may have been written.
        """


class WriteWatch:
    """Watches files. Writes to a file that stays open are not reported: that excludes our own."""

    def __init__(self, listener: WriteListener) -> None:
        self._listener = listener
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = self._checked(self._libc.inotify_init1(os.O_CLOEXEC))
        self._paths: dict[int, Path] = {}
        self._lock = threading.Lock()
        threading.Thread(target=self._follow, name="inotify", daemon=True).start()

    def add(self, path: Path) -> None:
        """Watch a file; OSError when it does not exist."""
        with self._lock:
            number = self._checked(self._libc.inotify_add_watch(self._descriptor, bytes(path), _CLOSE_WRITE))
            self._paths[number] = path

    def remove(self, path: Path) -> None:
        """Stop watching a file; for a deleted one this fails silently, as the kernel has removed its watch already."""
        with self._lock:
            for number in [number for number, known in self._paths.items() if known == path]:
                del self._paths[number]
                self._libc.inotify_rm_watch(self._descriptor, number)

    def _follow(self) -> None:
        while True:
            for number in _numbers(os.read(self._descriptor, _BUFFER)):
                heard = -inf if number < 0 else time.monotonic()
                for path in self._written(number):
                    self._listener.on_write(path, heard)

    def _written(self, number: int) -> list[Path]:
        """The file of a watch; all files when events were lost, for any may have been written."""
        with self._lock:
            if number < 0:
                return list(self._paths.values())
            return [self._paths[number]] if number in self._paths else []

    def _checked(self, result: int) -> int:
        if result < 0:
            code = ctypes.get_errno()
            raise OSError(code, _SPENT.get(code) or os.strerror(code))
        return result


def _numbers(events: bytes) -> Iterator[int]:
    """The watches whose files were written; -1 when the kernel's queue overflowed. A name may follow an event."""
    position = 0
    while position < len(events):
        number, mask, _, length = _HEADER.unpack_from(events, position)
        position += _HEADER.size + length
        if mask & (_CLOSE_WRITE | _OVERFLOW):
            yield number
