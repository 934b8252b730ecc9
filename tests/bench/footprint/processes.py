"""What processes of this machine take, from /proc."""

from __future__ import annotations

import os
import time
from pathlib import Path

TICK = os.sysconf("SC_CLK_TCK")


def resident(process: int) -> int:
    """Bytes of memory that the process has in RAM, shared libraries and all."""
    return _field(process, "status", "VmRSS:") * 1024


def peak(process: int) -> int:
    """The most of that it ever had."""
    return _field(process, "status", "VmHWM:") * 1024


def written(process: int) -> int:
    """Bytes that it has written to storage so far, as the kernel accounts them."""
    return _field(process, "io", "write_bytes:")


def cpu(process: int) -> float:
    """Seconds of CPU that it has used, with all its threads."""
    return sum(map(int, _stat(process)[11:13])) / TICK


def started(process: int) -> float:
    """The Unix time at which it started."""
    return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME) + int(_stat(process)[19]) / TICK


def parent(process: int) -> int:
    """The process that started it, or took it over."""
    return int(_stat(process)[1])


def _field(process: int, file: str, name: str) -> int:
    lines = Path(f"/proc/{process}/{file}").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


def _stat(process: int) -> list[str]:
    """The fields from the third on: the second, the name, may hold anything."""
    return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
