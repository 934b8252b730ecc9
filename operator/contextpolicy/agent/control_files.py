"""Open cgroup files, and those that hold a bandwidth (CPU time per period) for both schedulers and cgroup versions.

Files stay open: a write is one system call of 2 us, and the watch for files that are closed after writing (`inotify`)
never sees our own writes.
"""

from __future__ import annotations

import errno
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from contextpolicy.agent.agent_metrics import WRITES
from contextpolicy.agent.failures import GONE, NOT_ENABLED
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable

_WRITTEN = WRITES.labels("written")
_LEAST_LINKS = 2
"""Of a directory, where children are counted at all: its own name and its `.`."""
_REASONS = {
    errno.ENOENT: GONE,
    errno.ENODEV: GONE,
    errno.EBUSY: "Busy",
    errno.EINVAL: "OutOfBounds",
    errno.EACCES: "Forbidden",
    errno.EPERM: "Forbidden",
    errno.EROFS: "Forbidden",
}


@dataclass(frozen=True, slots=True)
class Format:
    """How a bandwidth is written: "time period" in one file (version 2) or a file for each (1), in microseconds.

    Where the period `moves` it is others', and a part of each text that is read, also in version 1.
    """

    file: str
    period_file: str
    unlimited: str
    least: int
    moves: bool = False


CFS = {
    1: Format("cpu.cfs_quota_us", "cpu.cfs_period_us", "-1", 1000, moves=True),
    2: Format("cpu.max", "", "max", 1000, moves=True),
}
"""CPU limits; the kernel's smallest quota is 1 ms. A kubelet that was restarted with another cpuCFSQuotaPeriod gives
that to each container that it resizes."""

REALTIME = {
    1: Format("cpu.rt_runtime_us", "cpu.rt_period_us", "-1", 0),
    2: Format("cpu.rt.max", "", "max", 0),
}
"""Realtime budgets. Kernels with hierarchical constant bandwidth servers have the file of version 2."""


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
            raise _failure(path, error) from error

    def read(self) -> str:
        """The file's text."""
        try:
            self.seen = self._text()
        except OSError as error:
            raise _failure(self.path, error) from error
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
            failure = _failure(self.path, error)
            WRITES.labels(failure.reason).inc()
            raise failure from error
        self._known, self.ours, self.written = text, text, time.monotonic()
        _WRITTEN.inc()

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    @property
    def watched(self) -> list[Path]:
        """The files whose change by others is news."""
        return [self.path]

    def _text(self) -> str:
        return _line(self._descriptor)

    def _content(self, text: str) -> str:
        """What has to be in the file for `read` to find the text."""
        return text


class ControlFile(OpenFile):
    """The file of a bandwidth. Amounts are thousandths of the period, None is no limit."""

    def __init__(self, group: Path, form: Format) -> None:
        super().__init__(group / form.file)
        self._form = form
        self._period_descriptor: int | None = None
        """Where the period has a file of its own, which others may write."""
        try:
            text = (group / (form.period_file or form.file)).read_text()
            if form.moves and form.period_file:
                self._period_descriptor = os.open(group / form.period_file, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            self.close()
            raise _failure(self.path, error) from error
        self.period = int(text.partition("\n")[0].split()[-1])

    def close(self) -> None:
        """Close the file, and that of its period."""
        super().close()
        if self._period_descriptor is not None:
            os.close(self._period_descriptor)

    @property
    def watched(self) -> list[Path]:
        """The files whose change by others is news."""
        period = self.period_path if self._form.moves else None
        return [self.path, *([period] if period else [])]

    def is_news(self, path: Path) -> bool:
        """Whether a write of one of the `watched` files may be news: each resize writes the period, mostly the same."""
        if path == self.path or self._period_descriptor is None:
            return True
        with suppress(OSError):
            return _line(self._period_descriptor) != str(self.period)
        return True

    def amount(self, text: str) -> int | None:
        """The amount that a text means, rounded up, so that it reverses the rounding down of `text`."""
        time, _, period = text.partition(" ")
        return None if time == self._form.unlimited else -(-int(time) * 1000 // int(period or self.period))

    def text(self, amount: int | None) -> str:
        """The text of an amount, no less than the kernel's minimum."""
        time = self._form.unlimited if amount is None else str(max(self._form.least, amount * self.period // 1000))
        return f"{time} {self.period}" if self._form.moves or not self._form.period_file else time

    def scaled(self, text: str, period: int) -> str:
        """The text of the same fraction of another period, in microseconds, rounded down."""
        time, _, _ = text.partition(" ")
        fewer = str(int(time) * period // self.period)
        return fewer if self._form.period_file else f"{fewer} {period}"

    @property
    def period_path(self) -> Path | None:
        """The separate file of the period (version 1), or None."""
        return self.path.parent / self._form.period_file if self._form.period_file else None

    def set_period(self, period: int) -> None:
        """Set the period in microseconds: at once in version 1, with the next `write` in version 2."""
        if self.period_path is not None:
            try:
                with self.period_path.open("r+b") as file:  # not truncated, so nobody reads an empty file
                    os.pwrite(file.fileno(), f"{period}\n".encode(), 0)
            except OSError as error:
                raise _failure(self.period_path, error) from error
        self.period = period

    def _text(self) -> str:
        text = super()._text()
        if self._period_descriptor is not None:
            text = f"{text} {_line(self._period_descriptor)}"
        if self._form.moves:
            self.period = int(text.rpartition(" ")[2])
        return text

    def _content(self, text: str) -> str:
        return text if self._period_descriptor is None else text.partition(" ")[0]


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
                raise _failure(file.path, error) from error
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


class ControlFiles(OpenFiles[ControlFile]):
    """Open files of one format of bandwidth."""

    def __init__(self, form: Format, watch: FileWatch) -> None:
        super().__init__(lambda group: ControlFile(group, form), watch)
        self.form = form

    def paths(self, groups: Iterable[Path]) -> set[Path]:
        """The files of groups; those of open ones, whose hash is known, at a tenth of the cost."""
        return {self[group].path if group in self else group / self.form.file for group in groups}


class Children:
    """The child groups of groups, listed again only when their number has changed: the kernel counts them as links."""

    def __init__(self) -> None:
        self._known: dict[Path, tuple[int, list[Path]]] = {}

    def of(self, group: Path) -> list[Path]:
        """The child groups; none when the group is gone."""
        try:
            links = group.stat().st_nlink
        except OSError:
            links = 0
        known = self._known.get(group)
        if known is None or known[0] != links or links < _LEAST_LINKS:
            known = self._known[group] = links, children(group)
        return known[1]

    def forget(self, group: Path) -> None:
        """One child has ended, so that another may have come without a change of their number."""
        self._known.pop(group, None)

    def all(self) -> list[Path]:
        """The child groups of all groups, as they were last found."""
        return [child for _, found in self._known.values() for child in found]

    def keep(self, groups: Container[Path]) -> None:
        """Forget all other groups."""
        for group in [group for group in self._known if group not in groups]:
            del self._known[group]


def children(group: Path) -> list[Path]:
    """The child groups; none when the group is gone."""
    try:
        return [Path(entry.path) for entry in os.scandir(group) if entry.is_dir(follow_symlinks=False)]
    except OSError:
        return []


def _line(descriptor: int) -> str:
    return os.pread(descriptor, 64, 0).decode().partition("\n")[0]


def _failure(path: Path, error: OSError) -> ActuationError:
    reason = _REASONS.get(error.errno or 0, "Failed")
    if error.errno == errno.ENOENT and path.parent.is_dir():
        wanted = "CPU controller that is enabled there (cgroup.subtree_control of the groups above)"
        return ActuationError(NOT_ENABLED, f"{path}: no such file: expected a {wanted}", retriable=False)
    return ActuationError(reason, f"{path}: {error.strerror}", retriable=reason == "Busy")
