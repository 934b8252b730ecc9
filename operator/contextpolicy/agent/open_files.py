"""Files of cgroups that stay open, under a watch.

A write is one system call of 2 us, and the watch for files that are closed after writing (`inotify`) never sees our own
writes.
"""

from __future__ import annotations

import errno
import os
import time
from math import inf
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from contextpolicy.agent.agent_metrics import WRITES
from contextpolicy.agent.failures import GONE, NOT_ENABLED
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

_WRITTEN = WRITES.labels("written")
_REASONS = {
    errno.ENOENT: GONE,
    errno.ENODEV: GONE,
    errno.EBUSY: "Busy",
    errno.EINVAL: "OutOfBounds",
    errno.EACCES: "Forbidden",
    errno.EPERM: "Forbidden",
    errno.EROFS: "Forbidden",
}


class OpenFile:
    """One file of a cgroup, open for reading and writing."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seen = ""
        """The text that `read` found last."""
        self.written = -inf
        """When we last wrote it, in seconds on the monotonic clock."""
        self.ours = ""
        """The text that we last wrote."""
        self._known = ""
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise failure_of(path, error) from error

    def read(self) -> str:
        """The file's text."""
        try:
            self.seen = self._text()
        except OSError as error:
            raise failure_of(self.path, error) from error
        self._known = self._known or self.seen
        return self.seen

    @property
    def unheard(self) -> bool:
        """Whether the last `read` found a foreign write that the watch has not reported (`heed`) yet."""
        return self.seen != self._known

    def heed(self) -> str:
        """Another process has written the file: its text."""
        self._known = ""
        return self.read()

    def write(self, text: str) -> None:
        """Write `text`; ActuationError says why the kernel refuses it."""
        try:
            os.pwrite(self._descriptor, f"{self._content(text)}\n".encode(), 0)
        except OSError as error:
            failure = failure_of(self.path, error)
            WRITES.labels(failure.reason).inc()
            raise failure from error
        self._known, self.ours, self.written = text, text, time.monotonic()
        _WRITTEN.inc()

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    @property
    def watched(self) -> list[Path]:
        """The files in which changes by others matter."""
        return [self.path]

    def _text(self) -> str:
        return line(self._descriptor)

    def _content(self, text: str) -> str:
        """What has to be in the file for `read` to find the text."""
        return text


File = TypeVar("File", bound=OpenFile)


class FileWatch(Protocol):
    """What follows the writes of others to open files, as `inotify.WriteWatch` does."""

    def add(self, path: Path) -> None:
        """The file is open; OSError when it does not exist."""

    def remove(self, path: Path) -> None:
        """The file is to be closed."""


class Unwatched:
    """Used where foreign writes need not be reported."""

    def add(self, path: Path) -> None:
        """Nothing to do."""

    def remove(self, path: Path) -> None:
        """Nothing to do."""


class OpenFiles(Generic[File]):
    """One open file of each group, under a watch."""

    def __init__(self, open_file: Callable[[Path], File], watch: FileWatch) -> None:
        self._open_file, self._watch = open_file, watch
        self._open: dict[Path, File] = {}

    def __getitem__(self, group: Path) -> File:
        """The group's file, opened if it is not yet; ActuationError, `Gone` when the group does not exist."""
        file = self._open.get(group)
        if file is None:
            file = self._open[group] = self._open_file(group)
            try:
                for path in file.watched:
                    self._watch.add(path)
            except OSError as error:
                self.close(group)
                raise failure_of(file.path, error) from error
        return file

    def __contains__(self, group: Path) -> bool:
        """Whether the group's file is open."""
        return group in self._open

    def keep(self, groups: Iterable[Path]) -> None:
        """Close the files of all other groups."""
        for group in self._open.keys() - set(groups):
            self.close(group)

    def close(self, group: Path) -> None:
        """Close the group's file, if it is open."""
        file = self._open.pop(group, None)
        if file is not None:
            for path in file.watched:
                self._watch.remove(path)
            file.close()


def line(descriptor: int) -> str:
    """The first line of an open file: its first 64 bytes at most."""
    return os.pread(descriptor, 64, 0).decode().partition("\n")[0]


def failure_of(path: Path, error: OSError) -> ActuationError:
    """The kernel's error, with a reason that says what became of the access."""
    reason = _REASONS.get(error.errno or 0, "Failed")
    if error.errno == errno.ENOENT and path.parent.is_dir():
        remedy = "enable the CPU controller there (cgroup.subtree_control of the parent groups)"
        return ActuationError(NOT_ENABLED, f"{path}: no such file: {remedy}", retriable=False)
    return ActuationError(reason, f"{path}: {error.strerror}", retriable=reason == "Busy")
