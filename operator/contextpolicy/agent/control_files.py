"""The files that hold a bandwidth (CPU time per period), for both schedulers and cgroup versions."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.agent.open_files import OpenFile, OpenFiles, failure_of, line

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from contextpolicy.agent.open_files import FileWatch


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
            raise failure_of(self.path, error) from error
        self.period = int(text.partition("\n")[0].split()[-1])

    def close(self) -> None:
        """Close the file, and that of its period."""
        super().close()
        if self._period_descriptor is not None:
            os.close(self._period_descriptor)

    @property
    def watched(self) -> list[Path]:
        """The files in which changes by others matter."""
        period = self.period_path if self._form.moves else None
        return [self.path, *([period] if period else [])]

    def is_news(self, path: Path) -> bool:
        """Whether a write of one of the `watched` files may matter: each resize writes the period, mostly the same."""
        if path == self.path or self._period_descriptor is None:
            return True
        with suppress(OSError):
            return line(self._period_descriptor) != str(self.period)
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
                raise failure_of(self.period_path, error) from error
        self.period = period

    def _text(self) -> str:
        text = super()._text()
        if self._period_descriptor is not None:
            text = f"{text} {line(self._period_descriptor)}"
        if self._form.moves:
            self.period = int(text.rpartition(" ")[2])
        return text

    def _content(self, text: str) -> str:
        return text if self._period_descriptor is None else text.partition(" ")[0]


class ControlFiles(OpenFiles[ControlFile]):
    """Open files of one format of bandwidth."""

    def __init__(self, form: Format, watch: FileWatch) -> None:
        super().__init__(lambda group: ControlFile(group, form), watch)
        self.form = form

    def paths(self, groups: Iterable[Path]) -> set[Path]:
        """The files of groups; those of open ones, whose hash is known, at a tenth of the cost."""
        return {self[group].path if group in self else group / self.form.file for group in groups}
