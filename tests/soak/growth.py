"""Whether a process grows: threads, sockets and memory over its life, and the slope of a line through them."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.cluster.api_connection import POOL
from contextpolicy.recorder.flight_recorder import SECONDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    Series = Sequence["Size"]

MIB = 2**20
MEMORY = 8.0
"""MiB by which a stretch may end above its beginning: Python's own arenas breathe by a few."""
THREADS = 3
"""Threads by which it may."""
SOCKETS = POOL
"""Sockets by which it may: connections to the API server are kept, as many as were ever needed at once. One that was
lost with each fault would be more within an hour."""
SETTLED = 30.0
"""Seconds after which a process has imported, connected and listed."""
FILLED = SECONDS + 60
"""Seconds after which the operator's flight recorder is full; of a shorter life, the second half is looked at."""


@dataclass(frozen=True)
class Size:
    """A process at one moment."""

    at: float
    pid: int
    threads: int
    sockets: int
    memory: int

    @classmethod
    def of(cls, pid: int, at: float, proc: Path = Path("/proc")) -> Size:
        """Read it; OSError when the process is gone."""
        status = (proc / str(pid) / "status").read_text(encoding="ascii", errors="replace").splitlines()
        fields = {name: value.split() for name, _, value in (line.partition(":") for line in status)}
        links = [_target(link) for link in (proc / str(pid) / "fd").iterdir()]
        sockets = sum(target.startswith("socket:") for target in links)
        return cls(at, pid, int(fields["Threads"][0]), sockets, int(fields["VmRSS"][0]) * 1024)


def last_life(sizes: Series) -> list[Size]:
    """The last process of a component, from when it had settled."""
    own = [size for size in sizes if size.pid == sizes[-1].pid]
    settling = max(SETTLED, min(FILLED, (own[-1].at - own[0].at) / 2)) if own else 0.0
    return [size for size in own if size.at >= own[0].at + settling]


def slope(sizes: Series) -> float:
    """MiB an hour, by least squares."""
    hours = [size.at / 3600 for size in sizes]
    return statistics.linear_regression(hours, [size.memory / MIB for size in sizes]).slope


def reported(name: str, sizes: Series) -> str:
    """One line for a person."""
    if len(sizes) < 2:
        return f"{name}: lived too briefly to judge"
    first, last = sizes[0], sizes[-1]
    handles = f"threads {first.threads} -> {last.threads}, sockets {first.sockets} -> {last.sockets}"
    memory = f"memory {first.memory / MIB:.1f} -> {last.memory / MIB:.1f} MiB, {slope(sizes):+.1f} MiB an hour"
    return f"{name}: {last.at - first.at:.0f} s, {handles}, {memory}"


def leaks(name: str, sizes: Series) -> list[str]:
    """What grew and should not have: the end of the life against its beginning, by medians of a tenth of it."""
    if len(sizes) < 2:
        return []
    part = max(1, len(sizes) // 10)
    bounds = {"threads": THREADS, "sockets": SOCKETS, "memory": MEMORY * MIB}
    found = []
    for what, bound in bounds.items():
        first, last = (
            statistics.median(getattr(one, what) for one in stretch) for stretch in (sizes[:part], sizes[-part:])
        )
        if last - first > bound:
            found.append(f"{name}: {what} went from {first:.0f} to {last:.0f}")
    return found


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:
        return ""  # closed in the meantime
